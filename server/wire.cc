#include "server/wire.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "server/limits.h"

namespace raymill::server {

static_assert(std::endian::native == std::endian::little, "rays and rows travel as they stand in memory");

namespace {

Status corrupt(std::string message) { return {ErrorCode::corrupt, std::move(message)}; }
Status invalid(std::string message) { return {ErrorCode::invalid_argument, std::move(message)}; }

template <typename Message>
Status parse(std::span<const std::byte> bytes, std::size_t most_bytes, Message& message) {
  message.Clear();
  if (bytes.size() > most_bytes) {
    return corrupt("a message of " + std::to_string(bytes.size()) + " bytes passes the limit of " +
                   std::to_string(most_bytes));
  }
  if (!message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
    return corrupt("the message is no " + message.GetTypeName());
  }
  return {};
}

Status check_frame(bool wanted, std::optional<std::size_t> frame_bytes) {
  if (wanted && !frame_bytes) {
    return corrupt("the raw frame that belongs to this message is missing");
  }
  if (!wanted && frame_bytes) {
    return corrupt("a raw frame came with a message that has none");
  }
  return {};
}

Status check_job_id(const std::string& id) {
  return is_job_id(id) ? Status() : invalid("a job id is 16 hexadecimal digits");
}

Status check_name(const std::string& name) {
  if (name.empty() || name.size() > kMostNameBytes) {
    return invalid("a store's name has 1 to " + std::to_string(kMostNameBytes) + " bytes, not " +
                   std::to_string(name.size()));
  }
  return {};
}

bool known(pb::Query query) { return query >= pb::QUERY_CLOSEST && query <= pb::QUERY_SPANS; }
bool known(pb::Mode mode) { return mode >= pb::MODE_WATERTIGHT && mode <= pb::MODE_EXACT; }
bool known(pb::JobState state) { return state >= pb::JOB_STATE_QUEUED && state <= pb::JOB_STATE_CANCELLED; }
bool known_fields(std::uint32_t fields) {
  return fields == std::uint32_t(Field::count) || fields == std::uint32_t(Field::transmittance) ||
         fields == std::uint32_t(kSpanFields) ||
         (fields != 0 && (fields & ~std::uint32_t(Field::all | Field::attributes)) == 0);
}

bool known(pb::VolumeMethod method) { return method >= pb::VOLUME_METHOD_EXACT && method <= pb::VOLUME_METHOD_RATIO; }

Status check(const pb::StartJob& start, std::optional<std::size_t> frame_bytes) {
  RAYMILL_RETURN_IF_ERROR(check_name(start.store()));
  if (!known(start.query())) {
    return invalid("query " + std::to_string(start.query()) + " is not known to this server");
  }
  if (!known(start.mode())) {
    return invalid("mode " + std::to_string(start.mode()) + " is not known to this server");
  }
  if (!known_fields(start.fields())) {
    return invalid("fields " + std::to_string(start.fields()) + " are none, or not all known to this server");
  }
  if (is_of_fog(from_wire(start.query())) && !known(start.volume().method())) {
    return invalid("volume method " + std::to_string(start.volume().method()) + " is not known to this server");
  }
  if (start.geometry_masks() > kMostGeometryMasks) {
    return {ErrorCode::unsupported, "a server takes masks of " + std::to_string(kMostGeometryMasks) +
                                        " geometries at most, not of " + std::to_string(start.geometry_masks())};
  }
  if (frame_bytes.value_or(0) != start.geometry_masks() * sizeof(std::uint32_t)) {
    return corrupt("a frame of " + std::to_string(frame_bytes.value_or(0)) + " bytes does not hold the masks of " +
                   std::to_string(start.geometry_masks()) + " geometries");
  }
  return {};
}

Status check(const pb::StoreDescription& store) {
  if (store.bounds_size() != 6) {
    return corrupt("a store's bounds have six numbers");
  }
  const auto& origin = store.origin();
  if (!std::all_of(origin.begin(), origin.end(), [](double x) { return std::isfinite(x); }) ||
      (origin.size() != 3 && !origin.empty())) {
    return corrupt("a store's origin has three numbers, or none");
  }
  return {};
}

Status check(const pb::Chunk& chunk, std::size_t frame_bytes) {
  RAYMILL_RETURN_IF_ERROR(check_job_id(chunk.job()));
  // What its job makes of it is for those who know the job.
  const std::uint64_t each = chunk.rays() > 0 ? frame_bytes / chunk.rays() : 0;
  if (each < sizeof(Ray) || each > sizeof(Ray64) + kMostExtraBytes || each * chunk.rays() != frame_bytes) {
    return {ErrorCode::bad_rays,
            "a chunk of " + std::to_string(chunk.rays()) + " rays has a frame of " + std::to_string(frame_bytes) +
                " bytes: 32 for each ray, 64 for one of float64, and what it brings, at least one ray"};
  }
  return {};
}

Status check(const pb::JobInfo& job) {
  RAYMILL_RETURN_IF_ERROR(check_job_id(job.id()));
  if (!known(job.state()) || !known(job.query()) || !known(job.mode()) || !known_fields(job.fields())) {
    return invalid("a job with a state, query, mode or field that is not known to this client");
  }
  return {};
}

Status check_lists(const pb::Rows& rows, std::size_t frame_bytes) {
  const std::uint64_t words = frame_bytes / sizeof(std::uint32_t);
  if (rows.rays() >= words || rows.rows() > words - rows.rays() - 1) {
    return corrupt("a frame of " + std::to_string(frame_bytes) + " bytes does not hold the lists of " +
                   std::to_string(rows.rays()) + " rays, " + std::to_string(rows.rows()) + " rows");
  }
  return {};
}

Status check_rows(std::uint64_t rows, std::size_t frame_bytes, bool may_be_empty) {
  if ((rows == 0 && !may_be_empty) || rows > frame_bytes || (rows == 0) != (frame_bytes == 0) ||
      (rows != 0 && frame_bytes % rows != 0)) {
    return corrupt("a frame of " + std::to_string(frame_bytes) + " bytes does not hold " + std::to_string(rows) +
                   " rows");
  }
  return {};
}

}  // namespace

Status decode(std::span<const std::byte> bytes, std::optional<std::size_t> frame_bytes, pb::ClientMessage& message) {
  RAYMILL_RETURN_IF_ERROR(parse(bytes, kMostRequestBytes, message));
  using Body = pb::ClientMessage;
  const auto kind = message.body_case();
  if (kind == Body::BODY_NOT_SET) {
    return corrupt("the message has no body that this server knows");
  }
  const bool has_masks = kind == Body::kStartJob && message.start_job().geometry_masks() > 0;
  RAYMILL_RETURN_IF_ERROR(check_frame(kind == Body::kChunk || has_masks, frame_bytes));
  switch (kind) {
    case Body::kHello:
      return message.hello().software().size() <= kMostSoftwareBytes ? Status()
                                                                     : invalid("software has 128 bytes at most");
    case Body::kOpenStore:
      return check_name(message.open_store().name());
    case Body::kDescribeStore:
      return check_name(message.describe_store().name());
    case Body::kStartJob:
      return check(message.start_job(), frame_bytes);
    case Body::kChunk:
      return check(message.chunk(), *frame_bytes);
    case Body::kFinishJob:
      return check_job_id(message.finish_job().job());
    case Body::kAcceptRows:
      return check_job_id(message.accept_rows().job());
    case Body::kCancelJob:
      return check_job_id(message.cancel_job().job());
    case Body::kGetJob:
      return check_job_id(message.get_job().job());
    case Body::kFetchRows:
      return check_job_id(message.fetch_rows().job());
    case Body::kGoodbye:
    case Body::kPing:
    case Body::kListStores:
    case Body::kListJobs:
    case Body::BODY_NOT_SET:
      break;
  }
  return {};
}

Status decode(std::span<const std::byte> bytes, std::optional<std::size_t> frame_bytes, pb::ServerMessage& message) {
  RAYMILL_RETURN_IF_ERROR(parse(bytes, kMostReplyBytes, message));
  using Body = pb::ServerMessage;
  const auto kind = message.body_case();
  if (kind == Body::BODY_NOT_SET) {
    return corrupt("the message has no body that this client knows");
  }
  RAYMILL_RETURN_IF_ERROR(
      check_frame(kind == Body::kRows || kind == Body::kFetchedRows || kind == Body::kStoreDescription, frame_bytes));
  switch (kind) {
    case Body::kError:
      return message.error().code() != 0 ? Status() : corrupt("an error without a code");
    case Body::kStoreDescription:
      return check(message.store_description());
    case Body::kJobAccepted: {
      const std::uint32_t chunk_rays = message.job_accepted().chunk_rays();
      if (chunk_rays == 0 || chunk_rays > kMostChunkRays) {
        return invalid("chunks of " + std::to_string(chunk_rays) + " rays");
      }
      return check(message.job_accepted().job());
    }
    case Body::kCredit:
      return check_job_id(message.credit().job());
    case Body::kRows: {
      RAYMILL_RETURN_IF_ERROR(check_job_id(message.rows().job()));
      return message.rows().rays() > 0 ? check_lists(message.rows(), *frame_bytes)
                                       : check_rows(message.rows().rows(), *frame_bytes, false);
    }
    case Body::kJobEnded:
      return check_job_id(message.job_ended().job());
    case Body::kJobReply:
      return check(message.job_reply().job());
    case Body::kJobList:
      for (const auto& job : message.job_list().jobs()) {
        RAYMILL_RETURN_IF_ERROR(check(job));
      }
      return {};
    case Body::kFetchedRows: {
      const auto& rows = message.fetched_rows();
      RAYMILL_RETURN_IF_ERROR(check_job_id(rows.job()));
      if (!known_fields(rows.fields())) {
        return invalid("rows with fields that are not known to this client");
      }
      return check_rows(rows.rows(), *frame_bytes, true);
    }
    case Body::kWelcome:
    case Body::kPong:
    case Body::kStoreOpened:
    case Body::kStoreList:
    case Body::BODY_NOT_SET:
      break;
  }
  return {};
}

std::span<const std::byte> bytes_of(const Frame& frame) {
  return {static_cast<const std::byte*>(frame.data()), frame.size()};
}
std::span<std::byte> bytes_of(Frame& frame) { return {static_cast<std::byte*>(frame.data()), frame.size()}; }

bool is_job_id(std::string_view id) {
  return id.size() == kJobIdBytes &&
         std::all_of(id.begin(), id.end(), [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

bool send_packet(zmq::socket_t& socket, std::optional<std::string_view> routing_id,
                 const google::protobuf::MessageLite& message, std::optional<Frame> frame) {
  const auto send = [&socket](Frame part, bool more) {
    // zmq_msg_send directly: cppzmq throws on EHOSTUNREACH, and a peer that left is no exception here.
    const int flags = ZMQ_DONTWAIT | (more ? ZMQ_SNDMORE : 0);
    return zmq_msg_send(part.handle(), socket.handle(), flags) >= 0;
  };
  Frame body(message.ByteSizeLong());
  if (!message.SerializeToArray(body.data(), static_cast<int>(body.size()))) {
    return false;
  }
  if (routing_id && !send(Frame(routing_id->data(), routing_id->size()), true)) {
    return false;
  }
  if (!send(std::move(body), frame.has_value())) {
    return false;
  }
  return !frame || send(std::move(*frame), false);
}

bool receive_parts(zmq::socket_t& socket, ReceivedParts& received) {
  received.count = 0;
  received.too_many = false;
  Frame part;
  do {
    if (zmq_msg_recv(part.handle(), socket.handle(), ZMQ_DONTWAIT) < 0) {
      return false;
    }
    const bool more = part.more();
    if (received.count < ReceivedParts::kMostParts) {
      received.parts[received.count++].move(part);
    } else {
      received.too_many = true;
    }
    if (!more) {
      return true;
    }
  } while (true);
}

}  // namespace raymill::server
