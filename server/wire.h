// Messages as they travel: a Protocol Buffers part, and for some a raw frame beside it.
//
// Decoding never trusts its bytes: what it lets through has a known body, legal sizes, known enum values and a frame
// exactly where one belongs. What needs the job's or the connection's state is checked by whoever holds that state.
// Functions are thread-safe; messages are thread-compatible.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <zmq.hpp>

#include "server/protocol.pb.h"
#include "storage/base/status.h"
#include "traversal/service.h"

namespace raymill::server {

namespace pb = ::raymill::protocol;

/// A raw frame; it owns its bytes, and gives them back wherever ZeroMQ lets go of them.
using Frame = zmq::message_t;

struct ClientPacket {
  pb::ClientMessage message;
  std::optional<Frame> frame;
};

struct ServerPacket {
  pb::ServerMessage message;
  std::optional<Frame> frame;
};

/// Reads a message of a client. `message.sequence` is set wherever the bytes could be parsed, even on errors, so that
/// the error can be answered. `frame_bytes` is empty where no frame came.
/// Errors: corrupt (not such a message), invalid_argument (a value out of its range), bad_rays (size of the frame).
Status decode(std::span<const std::byte> bytes, std::optional<std::size_t> frame_bytes, pb::ClientMessage& message);
/// The same for a message of a server.
Status decode(std::span<const std::byte> bytes, std::optional<std::size_t> frame_bytes, pb::ServerMessage& message);

std::span<const std::byte> bytes_of(const Frame& frame);
std::span<std::byte> bytes_of(Frame& frame);

/// Job ids are 16 lower-case hexadecimal digits: they name spool files too.
bool is_job_id(std::string_view id);

// Values between the library and the wire. The readers of enums expect values that decode() has let through.
/// Without geometry masks, which stand in the frame.
TraceConfig to_trace_config(const pb::StartJob& start);
/// The other way.
void fill(const TraceConfig& config, pb::StartJob& start);
/// Bytes of a chunk for each ray.
std::size_t ray_bytes(const TraceConfig& config);
pb::Query to_wire(Query query);
pb::Mode to_wire(Mode mode);
Query from_wire(pb::Query query);
Mode from_wire(pb::Mode mode);
pb::JobStats to_wire(const JobStats& stats);
JobStats from_wire(const pb::JobStats& stats);
pb::StoreDescription to_wire(const StoreInfo& info);
StoreInfo from_wire(const pb::StoreDescription& description, std::string_view metadata);
/// A Status from a peer's code and sentence; codes that this build does not know become internal.
Status status_from_wire(std::uint32_t code, std::string_view message);
/// Cuts a sentence to kMostSentenceBytes, at a character's border.
std::string cut_sentence(std::string_view sentence);
/// Makes text safe for a protobuf string: bytes that are no UTF-8 become '?'.
std::string utf8_or_question_marks(std::string_view text);

/// Sends both parts without waiting. EAGAIN (peer's queue full) and EHOSTUNREACH (peer gone) answer false.
bool send_packet(zmq::socket_t& socket, std::optional<std::string_view> routing_id,
                 const google::protobuf::MessageLite& message, std::optional<Frame> frame);

/// The parts of one received message, routing id included where `socket` is a ROUTER. Parts beyond `most_parts` are
/// read and dropped, and `too_many` says so.
struct ReceivedParts {
  static constexpr std::size_t kMostParts = 3;
  std::array<Frame, kMostParts> parts;
  std::size_t count = 0;
  bool too_many = false;
};
/// One message, if one is there.
bool receive_parts(zmq::socket_t& socket, ReceivedParts& received);

}  // namespace raymill::server
