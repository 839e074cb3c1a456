#include "client/cpp/connection.h"

#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <system_error>
#include <utility>

#include "server/address.h"
#include "server/limits.h"

namespace raymill::client {

namespace {

/// How long the goodbye may take to leave.
constexpr int kLingerMillis = 200;
constexpr std::chrono::milliseconds kLongestPingInterval{1000};
constexpr std::chrono::milliseconds kShortestPingInterval{5};

std::string seconds_text(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", seconds);
  return text;
}

Status error_status(const pb::Error& error) { return server::status_from_wire(error.code(), error.message()); }

}  // namespace

Result<std::unique_ptr<Connection>> Connection::open(std::shared_ptr<zmq::context_t> context,
                                                     const ClientConfig& config, Handlers handlers) {
  RAYMILL_RETURN_IF_ERROR(server::check_client_address(config.address));
  if (!(config.timeout_seconds >= 0.01 && config.timeout_seconds <= 1e6)) {
    return {ErrorCode::invalid_argument, "a timeout is 0.01 to 1e6 seconds"};
  }
  server::FileDescriptor wake(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  if (!wake.valid()) {
    return {ErrorCode::io, "no eventfd for a connection; are too many files open?"};
  }
  std::unique_ptr<Connection> connection;
  try {
    connection.reset(new Connection(std::move(context), config, std::move(handlers), std::move(wake)));
    connection->socket_.connect(config.address);
    connection->thread_ = std::thread([raw = connection.get()] { raw->run(); });
  } catch (const zmq::error_t& error) {
    return {ErrorCode::io, "cannot connect to " + config.address + ": " + error.what()};
  } catch (const std::system_error& error) {
    return {ErrorCode::io, "no thread for a connection to " + config.address + ": " + error.what()};
  }

  pb::ClientMessage message;
  message.mutable_hello()->set_protocol_version(server::kProtocolVersion);
  message.mutable_hello()->set_software("raymill");
  RAYMILL_ASSIGN_OR_RETURN(const ServerPacket answer, connection->call(std::move(message)));
  if (!answer.message.has_welcome()) {
    return {ErrorCode::corrupt, config.address + " answered a hello with something else than a welcome"};
  }
  if (answer.message.welcome().protocol_version() != server::kProtocolVersion) {
    return {ErrorCode::version_mismatch, "the server at " + config.address + " speaks another version of the protocol"};
  }
  return connection;
}

Connection::Connection(std::shared_ptr<zmq::context_t> context, const ClientConfig& config, Handlers handlers,
                       server::FileDescriptor wake)
    : context_(std::move(context)),
      config_(config),
      handlers_(std::move(handlers)),
      wake_(std::move(wake)),
      socket_(*context_, zmq::socket_type::dealer),
      ping_interval_(std::clamp(std::chrono::milliseconds(static_cast<std::int64_t>(config.timeout_seconds * 250)),
                                kShortestPingInterval, kLongestPingInterval)) {
  socket_.set(zmq::sockopt::linger, kLingerMillis);
  socket_.set(zmq::sockopt::ipv6, true);
  socket_.set(zmq::sockopt::maxmsgsize, static_cast<std::int64_t>(server::kMostMetadataBytes));
  last_ping_ = last_turn_ = std::chrono::steady_clock::now();
}

Connection::~Connection() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake();
  if (thread_.joinable()) {
    thread_.join();
  }
}

void Connection::wake() const {
  const std::uint64_t one = 1;
  while (::write(wake_.get(), &one, sizeof one) < 0 && errno == EINTR) {
  }
}

Result<ServerPacket> Connection::call(pb::ClientMessage message, std::optional<Frame> frame) {
  std::unique_lock lock(mutex_);
  if (!lost_.ok()) {
    return lost_;
  }
  const std::uint64_t sequence = ++last_sequence_;
  message.set_sequence(sequence);
  waiting_.try_emplace(sequence);
  outgoing_.push_back({std::move(message), std::move(frame)});
  wake();
  answered_.wait(lock, [&] { return !lost_.ok() || waiting_.at(sequence).answer.has_value(); });
  std::optional<ServerPacket> answer = std::move(waiting_.at(sequence).answer);
  waiting_.erase(sequence);
  if (!answer) {
    return lost_;
  }
  if (answer->message.has_error()) {
    return error_status(answer->message.error());
  }
  return std::move(*answer);
}

void Connection::post(pb::ClientMessage message, std::optional<Frame> frame) {
  {
    const std::lock_guard lock(mutex_);
    if (!lost_.ok()) {
      return;
    }
    outgoing_.push_back({std::move(message), std::move(frame)});
  }
  wake();
}

void Connection::run() {
  while (true) {
    bool stopping = false;
    bool sending = false;
    {
      const std::lock_guard lock(mutex_);
      stopping = stopping_;
      sending = !outgoing_.empty();
      if (!lost_.ok() || stopping) {
        break;
      }
    }
    const auto events = static_cast<short>(ZMQ_POLLIN | (sending ? ZMQ_POLLOUT : 0));
    zmq::pollitem_t items[] = {{socket_.handle(), 0, events, 0}, {nullptr, wake_.get(), ZMQ_POLLIN, 0}};
    if (zmq_poll(items, 2, static_cast<long>(ping_interval_.count())) < 0 && zmq_errno() != EINTR) {
      lose({ErrorCode::internal, std::string("the connection cannot wait for messages: ") + zmq_strerror(zmq_errno())});
      break;
    }
    std::uint64_t count = 0;
    (void)!::read(wake_.get(), &count, sizeof count);
    receive();
    send_outgoing();
    keep_alive(std::chrono::steady_clock::now());
  }
  // What was posted last (a cancel), then the goodbye; without waiting for a server that may be gone.
  pb::ClientMessage goodbye;
  goodbye.mutable_goodbye();
  send_outgoing();
  (void)server::send_packet(socket_, std::nullopt, goodbye, std::nullopt);
  socket_.close();
}

void Connection::send_outgoing() {
  while ((socket_.get(zmq::sockopt::events) & ZMQ_POLLOUT) != 0) {
    std::optional<ClientPacket> packet;
    {
      const std::lock_guard lock(mutex_);
      if (outgoing_.empty()) {
        return;
      }
      packet.emplace(std::move(outgoing_.front()));
      outgoing_.pop_front();
    }
    (void)server::send_packet(socket_, std::nullopt, packet->message, std::move(packet->frame));
    expecting_ = expecting_ || packet->message.sequence() != 0;
  }
}

void Connection::receive() {
  server::ReceivedParts received;
  while (server::receive_parts(socket_, received)) {
    silent_for_ = std::chrono::milliseconds(0);
    expecting_ = false;
    if (received.too_many || received.count > 2) {
      lose({ErrorCode::corrupt, config_.address + " sent a message of too many parts"});
      return;
    }
    ServerPacket packet;
    if (received.count == 2) {
      packet.frame.emplace(std::move(received.parts[1]));
    }
    const auto frame_bytes = packet.frame ? std::optional(packet.frame->size()) : std::nullopt;
    const Status status =
        server::decode(server::bytes_of(std::as_const(received.parts[0])), frame_bytes, packet.message);
    if (!status.ok()) {
      lose({status.code(), config_.address + " sent what no server of this version sends: " + status.message()});
      return;
    }
    deliver(std::move(packet));
  }
}

void Connection::deliver(ServerPacket&& packet) {
  const std::uint64_t sequence = packet.message.sequence();
  if (packet.message.has_welcome()) {
    // Four signs of life in the time after which the server would give this client up.
    const std::chrono::milliseconds quarter(packet.message.welcome().silence_millis() / 4);
    ping_interval_ = std::clamp(quarter, kShortestPingInterval, ping_interval_);
  }
  if (sequence != 0) {
    const std::lock_guard lock(mutex_);
    if (const auto found = waiting_.find(sequence); found != waiting_.end()) {
      found->second.answer = std::move(packet);
      answered_.notify_all();
    }
    return;
  }
  if (packet.message.has_error() && packet.message.error().job().empty()) {
    // About the connection as a whole: the server does not know it any more.
    lose(error_status(packet.message.error()));
    return;
  }
  handlers_.message(std::move(packet));
}

void Connection::keep_alive(TimePoint now) {
  // A turn that took longer than two pings means that this process slept, not that the server did.
  const auto turn = std::chrono::duration_cast<std::chrono::milliseconds>(now - last_turn_);
  last_turn_ = now;
  if (expecting_) {
    silent_for_ += std::min(turn, 2 * ping_interval_);
  }
  const std::chrono::duration<double> silent = silent_for_;
  if (silent.count() >= config_.timeout_seconds) {
    lose({ErrorCode::unavailable, "no answer from " + config_.address + " within " +
                                      seconds_text(config_.timeout_seconds) + " s; is `raymill serve` running there?"});
    return;
  }
  if (now - last_ping_ >= ping_interval_) {
    pb::ClientMessage ping;
    ping.mutable_ping();
    (void)server::send_packet(socket_, std::nullopt, ping, std::nullopt);
    last_ping_ = now;
    expecting_ = true;
  }
}

void Connection::lose(const Status& status) {
  {
    const std::lock_guard lock(mutex_);
    if (!lost_.ok()) {
      return;
    }
    lost_ = status;
    outgoing_.clear();
  }
  answered_.notify_all();
  handlers_.lost(status);
}

}  // namespace raymill::client
