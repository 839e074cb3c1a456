#include "storage/base/status.h"

#include <gtest/gtest.h>

#include <set>
#include <string>

namespace raymill {
namespace {

constexpr ErrorCode kAll[] = {
    ErrorCode::ok,           ErrorCode::invalid_argument, ErrorCode::not_found,         ErrorCode::unsupported,
    ErrorCode::unauthorised, ErrorCode::corrupt,          ErrorCode::checksum_mismatch, ErrorCode::version_mismatch,
    ErrorCode::bad_scene,    ErrorCode::bad_rays,         ErrorCode::budget_exceeded,   ErrorCode::io,
    ErrorCode::disk_full,    ErrorCode::busy_retry,       ErrorCode::unavailable,       ErrorCode::cancelled,
    ErrorCode::interrupted,  ErrorCode::internal};

TEST(Status, DefaultIsOk) {
  EXPECT_TRUE(Status().ok());
  EXPECT_EQ(Status().code(), ErrorCode::ok);
  EXPECT_TRUE(Status().message().empty());
}

TEST(Status, EveryCodeHasANameOfItsOwn) {
  std::set<std::string> names;
  for (const ErrorCode code : kAll) {
    EXPECT_NE(to_string(code), "unknown") << static_cast<int>(code);
    EXPECT_TRUE(names.insert(std::string(to_string(code))).second) << to_string(code);
  }
  EXPECT_EQ(to_string(static_cast<ErrorCode>(999)), "unknown");
}

TEST(Status, CodesAreNeverRenumbered) {
  EXPECT_EQ(static_cast<int>(ErrorCode::invalid_argument), 10);
  EXPECT_EQ(static_cast<int>(ErrorCode::corrupt), 20);
  EXPECT_EQ(static_cast<int>(ErrorCode::checksum_mismatch), 21);
  EXPECT_EQ(static_cast<int>(ErrorCode::version_mismatch), 22);
  EXPECT_EQ(static_cast<int>(ErrorCode::budget_exceeded), 30);
  EXPECT_EQ(static_cast<int>(ErrorCode::busy_retry), 40);
  EXPECT_EQ(static_cast<int>(ErrorCode::internal), 50);
}

TEST(Status, ExitCodesAreTheDocumentedOnes) {
  EXPECT_EQ(exit_code(ErrorCode::ok), 0);
  EXPECT_EQ(exit_code(ErrorCode::invalid_argument), 2);
  EXPECT_EQ(exit_code(ErrorCode::budget_exceeded), 33);
  EXPECT_EQ(exit_code(ErrorCode::corrupt), 42);
  EXPECT_EQ(exit_code(ErrorCode::checksum_mismatch), 42);
  EXPECT_EQ(exit_code(ErrorCode::bad_scene), 42);
  EXPECT_EQ(exit_code(ErrorCode::io), 75);
  EXPECT_EQ(exit_code(ErrorCode::disk_full), 75);
  EXPECT_EQ(exit_code(ErrorCode::busy_retry), 75);
  EXPECT_EQ(exit_code(ErrorCode::cancelled), 130);
  for (const ErrorCode code : kAll) {
    EXPECT_EQ(exit_code(code) == 0, code == ErrorCode::ok) << to_string(code);
  }
}

Result<int> half(int value) {
  if (value % 2 != 0) {
    return {ErrorCode::invalid_argument, std::to_string(value) + " is odd"};
  }
  return value / 2;
}

Result<int> quarter(int value) {
  RAYMILL_ASSIGN_OR_RETURN(const int once, half(value));
  RAYMILL_ASSIGN_OR_RETURN(const int twice, half(once));
  return twice;
}

TEST(Result, HoldsAValueOrAStatus) {
  EXPECT_EQ(half(4).value(), 2);
  EXPECT_EQ(half(3).status().code(), ErrorCode::invalid_argument);
  EXPECT_FALSE(half(3));
}

TEST(Result, MacroHandsTheStatusOn) {
  EXPECT_EQ(*quarter(8), 2);
  EXPECT_EQ(quarter(6).status().message(), "3 is odd");
  EXPECT_EQ(quarter(5).status().message(), "5 is odd");
}

}  // namespace
}  // namespace raymill
