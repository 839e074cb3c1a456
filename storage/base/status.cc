#include "storage/base/status.h"

namespace raymill {

std::string_view to_string(ErrorCode code) {
  switch (code) {
    case ErrorCode::ok:
      return "ok";
    case ErrorCode::invalid_argument:
      return "invalid_argument";
    case ErrorCode::not_found:
      return "not_found";
    case ErrorCode::unsupported:
      return "unsupported";
    case ErrorCode::unauthorised:
      return "unauthorised";
    case ErrorCode::corrupt:
      return "corrupt";
    case ErrorCode::checksum_mismatch:
      return "checksum_mismatch";
    case ErrorCode::version_mismatch:
      return "version_mismatch";
    case ErrorCode::bad_scene:
      return "bad_scene";
    case ErrorCode::bad_rays:
      return "bad_rays";
    case ErrorCode::budget_exceeded:
      return "budget_exceeded";
    case ErrorCode::io:
      return "io";
    case ErrorCode::disk_full:
      return "disk_full";
    case ErrorCode::busy_retry:
      return "busy_retry";
    case ErrorCode::unavailable:
      return "unavailable";
    case ErrorCode::cancelled:
      return "cancelled";
    case ErrorCode::interrupted:
      return "interrupted";
    case ErrorCode::internal:
      return "internal";
  }
  return "unknown";
}

int exit_code(ErrorCode code) {
  switch (code) {
    case ErrorCode::ok:
      return 0;
    case ErrorCode::invalid_argument:
    case ErrorCode::unauthorised:
      return 2;
    case ErrorCode::budget_exceeded:
      return 33;
    case ErrorCode::not_found:
    case ErrorCode::unsupported:
    case ErrorCode::corrupt:
    case ErrorCode::checksum_mismatch:
    case ErrorCode::version_mismatch:
    case ErrorCode::bad_scene:
    case ErrorCode::bad_rays:
      return 42;
    case ErrorCode::io:
    case ErrorCode::disk_full:
    case ErrorCode::busy_retry:
    case ErrorCode::unavailable:
    case ErrorCode::internal:
      return 75;
    case ErrorCode::cancelled:
    case ErrorCode::interrupted:
      return 130;
  }
  return 75;
}

}  // namespace raymill
