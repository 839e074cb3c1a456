#include "client/cli/npy.h"

#include <gtest/gtest.h>

namespace raymill::client {
namespace {

std::string file_of(const std::string& dictionary, char major = 1) {
  std::string file = "\x93NUMPY";
  file += major;
  file += '\0';
  const std::size_t length = dictionary.size();
  for (int i = 0; i < (major == 1 ? 2 : 4); ++i) {
    file += static_cast<char>(length >> (8 * i));
  }
  return file + dictionary;
}

Result<NpyHeader> parse(const std::string& file) { return parse_npy_header(std::as_bytes(std::span(file))); }

TEST(NpyHeader, ReadsWhatItWrites) {
  for (const std::uint64_t rows : {std::uint64_t{0}, std::uint64_t{7}, std::uint64_t{123456789012345}}) {
    const std::string text = npy_header("'<f4'", rows, 8);
    EXPECT_EQ(text.size() % 64, 0U);
    EXPECT_EQ(text.back(), '\n');
    const auto header = parse(text);
    ASSERT_TRUE(header) << header.status().message();
    EXPECT_EQ(header->descr, "<f4");
    EXPECT_FALSE(header->fortran_order);
    EXPECT_EQ(header->shape, (std::vector<std::uint64_t>{rows, 8}));
    EXPECT_EQ(header->data_offset, text.size());
  }
}

TEST(NpyHeader, StructuredTypeIsKeptAsText) {
  const std::string descr = "[('t', '<f4'), ('primitive_id', '<u4')]";
  const auto header = parse(npy_header(descr, 5, 0));
  ASSERT_TRUE(header) << header.status().message();
  EXPECT_EQ(header->descr, descr);
  EXPECT_EQ(header->shape, (std::vector<std::uint64_t>{5}));
}

TEST(NpyHeader, AcceptsOtherWritersSpelling) {
  EXPECT_TRUE(parse(file_of("{\"shape\":(3,6),\"descr\":\"<f8\",\"fortran_order\":True}")));
  EXPECT_TRUE(parse(file_of("{'descr': '<f4', 'fortran_order': False, 'shape': ( 3 , 6 , ), }   \n", 2)));
  EXPECT_TRUE(parse(file_of("{'descr': '<f4', 'fortran_order': False, 'shape': (), }", 3)));
}

TEST(NpyHeader, RefusesWhatBreaksTheFormat) {
  const std::string good = "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 6), }";
  ASSERT_TRUE(parse(file_of(good)));
  for (const std::string& file :
       {std::string(), std::string("\x93NUMPY"), std::string("PK\3\4 a zip file"), file_of(good, 4), file_of(good, 0),
        file_of(good).substr(0, 40), file_of(good + "x"), file_of("[]"), file_of("{'descr': '<f4'"),
        file_of("{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (3, 6), }"),
        file_of("{'descr': '<f4', 'fortran_order': 0, 'shape': (3, 6), }"),
        file_of("{'descr': '<f4', 'fortran_order': False, 'shape': (-3, 6), }"),
        file_of("{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999999, 6), }"),
        file_of("{'descr': '<f4', 'fortran_order': False, 'shape': 3, }"),
        file_of("{'descr': ['<f4', 'fortran_order': False, 'shape': (3, 6), }"),
        file_of("{'descr': '<f4, 'fortran_order': False, 'shape': (3, 6), }"),
        file_of("{'descr': '<f4', 'fortran_order': False, }"), file_of("{'secret': 1, }")}) {
    const auto header = parse(file);
    ASSERT_FALSE(header) << file;
    EXPECT_EQ(header.status().code(), ErrorCode::bad_rays);
  }
}

TEST(NpyHeader, IsAsLongAsItHasToBe) {
  const std::string longest = npy_header("'<f4'", ~std::uint64_t{0}, 0);
  const std::string filled = npy_header("'<f4'", 7, 0, longest.size());
  EXPECT_EQ(filled.size(), longest.size());
  EXPECT_EQ(npy_header("'<f4'", 7, 0, 192).size(), 192u);
  const auto header = parse(npy_header("'<f4'", 7, 0, 192));
  ASSERT_TRUE(header) << header.status().message();
  EXPECT_EQ(header->shape, std::vector<std::uint64_t>{7});
  EXPECT_EQ(header->data_offset, 192u);
}

TEST(NpyHeader, LengthIsNotTrusted) {
  std::string file = file_of("{}", 2);
  file[8] = file[9] = file[10] = file[11] = '\xFF';
  EXPECT_FALSE(parse(file));
}

}  // namespace
}  // namespace raymill::client
