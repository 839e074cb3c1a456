#include "client/cli/render/picture.h"

#include <cstdlib>
#include <limits>
#include <vector>

#include "tests/support/effort.h"
#include "tests/unit/client/cli/folder.h"

namespace raymill::client {
namespace {

class PictureTest : public FolderTest {
 protected:
  PictureTest() { ::setenv("RAYMILL_IMAGE_WRITER", RAYMILL_IMAGE_PROGRAM, 1); }
};

TEST_F(PictureTest, WritesBothFormats) {
  const struct {
    const char* name;
    const char* begins;
  } cases[] = {{"out.png", "\x89PNG"}, {"out.exr", "\x76\x2f\x31\x01"}};
  for (const auto& [name, begins] : cases) {
    for (const Tone tone : {Tone::distance, Tone::direction, Tone::linear, Tone::radiance}) {
      if (tests::kSanitized && (tone == Tone::linear || tone == Tone::radiance) != (name == std::string("out.exr"))) {
        continue;
      }
      const std::uint32_t channels = tone == Tone::distance || tone == Tone::linear ? 1 : 3;
      auto picture = Picture::create(path(name), {.width = 20, .height = 10}, channels, tone);
      ASSERT_TRUE(picture) << picture.status().message();
      std::vector<float> rows(std::size_t{20} * 5 * channels, 0.5F);
      rows[3] = std::numeric_limits<float>::infinity();
      ASSERT_TRUE(picture->append(rows).ok());
      ASSERT_TRUE(picture->append(rows).ok());
      const Status status = picture->commit();
      ASSERT_TRUE(status.ok()) << status.message();
      EXPECT_EQ(read(name).substr(0, 4), begins);
    }
  }
  EXPECT_EQ(files(), 2U);
}

TEST_F(PictureTest, MissingRowsAreAnErrorThatLeavesNothing) {
  {
    auto picture = Picture::create(path("out.png"), {.width = 20, .height = 10}, 1, Tone::linear);
    ASSERT_TRUE(picture);
    const std::vector<float> row(20);
    ASSERT_TRUE(picture->append(row).ok());
    const Status status = picture->commit();
    EXPECT_EQ(status.code(), ErrorCode::io);
    EXPECT_NE(status.message().find("ends early"), std::string::npos) << status.message();
  }
  EXPECT_EQ(files(), 0U);
}

TEST_F(PictureTest, EndingIsCheckedBeforeAnythingIsMade) {
  const auto picture = Picture::create(path("out.jpg"), {.width = 20, .height = 10}, 1, Tone::linear);
  ASSERT_FALSE(picture);
  EXPECT_EQ(picture.status().code(), ErrorCode::invalid_argument);
  EXPECT_EQ(files(), 0U);
}

TEST_F(PictureTest, MissingProgramIsNamed) {
  ::setenv("RAYMILL_IMAGE_WRITER", path("nothing").c_str(), 1);
  const auto picture = Picture::create(path("out.png"), {.width = 20, .height = 10}, 1, Tone::linear);
  ASSERT_FALSE(picture);
  EXPECT_EQ(picture.status().code(), ErrorCode::not_found);
}

}  // namespace
}  // namespace raymill::client
