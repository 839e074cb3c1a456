// Fuzzes the decoders of both directions of the protocol: nothing that arrives may crash either end, and what a
// decoder lets through must be safe to use.
//
// Input: byte 0 chooses the direction (bit 0), whether a frame came (bit 1) and its size (the other bits); the rest
// is the Protocol Buffers part.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <span>
#include <vector>

#include "server/limits.h"
#include "server/list_frames.h"
#include "server/store_names.h"
#include "server/wire.h"

namespace raymill::server {
namespace {

void require(bool promise) {
  if (!promise) {
    std::abort();
  }
}

void fuzz_client_message(std::span<const std::byte> bytes, std::optional<std::size_t> frame_bytes) {
  pb::ClientMessage message;
  if (!decode(bytes, frame_bytes, message).ok()) {
    return;
  }
  if (message.has_start_job()) {
    const TraceConfig config = to_trace_config(message.start_job());
    require(ray_bytes(config) >= sizeof(Ray) && ray_bytes(config) <= sizeof(Ray64) + kMostExtraBytes);
    require(frame_bytes.value_or(0) == message.start_job().geometry_masks() * sizeof(std::uint32_t));
    require(HitLayout(config.fields).row_bytes() > 0 && HitLayout(config.fields).row_bytes() <= kMostRowBytes);
    const auto name = canonical_store_name(message.start_job().store());
    require(!name.ok() || canonical_store_name(*name + ".mill").ok());
  }
  if (message.has_chunk()) {
    const std::uint64_t rays = message.chunk().rays();
    require(frame_bytes && rays > 0 && *frame_bytes % rays == 0);
    require(*frame_bytes / rays >= sizeof(Ray) && *frame_bytes / rays <= sizeof(Ray64) + kMostExtraBytes);
  }
}

void fuzz_server_message(std::span<const std::byte> bytes, std::optional<std::size_t> frame_bytes) {
  pb::ServerMessage message;
  if (!decode(bytes, frame_bytes, message).ok()) {
    return;
  }
  if (message.has_rows()) {
    const pb::Rows& rows = message.rows();
    if (rows.rays() == 0) {
      require(rows.rows() > 0 && *frame_bytes % rows.rows() == 0);
    } else {
      const std::vector<std::byte> frame(*frame_bytes);
      (void)read_offsets(frame, rows.rays(), rows.rows(), sizeof(float));
    }
  }
  if (message.has_store_description()) {
    (void)from_wire(message.store_description(), "{}");
  }
  if (message.has_job_ended()) {
    (void)from_wire(message.job_ended().stats());
    (void)status_from_wire(message.job_ended().code(), message.job_ended().message());
  }
  if (message.has_error()) {
    require(!status_from_wire(message.error().code(), message.error().message()).ok());
  }
}

}  // namespace
}  // namespace raymill::server

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) {
    return 0;
  }
  const auto bytes = std::as_bytes(std::span(data, size)).subspan(1);
  const bool has_frame = (data[0] & 2u) != 0;
  // 0, 8, 16, ... bytes: sizes that are and that are not whole rays.
  const auto frame_bytes = has_frame ? std::optional<std::size_t>((data[0] >> 2u) * 8u) : std::nullopt;
  if ((data[0] & 1u) == 0) {
    raymill::server::fuzz_client_message(bytes, frame_bytes);
  } else {
    raymill::server::fuzz_server_message(bytes, frame_bytes);
  }
  return 0;
}
