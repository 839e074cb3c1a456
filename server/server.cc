#include "server/server.h"

#include <algorithm>
#include <atomic>
#include <charconv>
#include <filesystem>
#include <utility>

#include "server/desk.h"
#include "server/endpoint.h"
#include "server/events.h"
#include "server/job_table.h"
#include "server/limits.h"
#include "server/spool.h"

namespace raymill::server {

namespace {

/// Messages handled before the timers get their turn.
constexpr int kMessagesPerTurn = 64;
/// How long answers may take to leave after the last one.
constexpr int kLingerMillis = 500;

std::chrono::milliseconds to_millis(double seconds) {
  constexpr double kMostSeconds = 1e7;
  return std::chrono::milliseconds(static_cast<std::int64_t>(std::clamp(seconds, 0.0, kMostSeconds) * 1000.0));
}

Status check(const ServeConfig& config) {
  if (config.max_jobs == 0 || config.max_stores == 0 || config.max_connections == 0) {
    return {ErrorCode::invalid_argument, "a server needs at least one job, one store and one connection"};
  }
  if (!(config.silence_seconds >= 0.1) || !(config.idle_seconds >= 0)) {
    return {ErrorCode::invalid_argument, "silence_seconds is at least 0.1 and idle_seconds at least 0"};
  }
  std::error_code error;
  if (!std::filesystem::is_directory(config.stores_directory, error)) {
    return {ErrorCode::not_found, "no directory '" + config.stores_directory + "' with stores; give one with --stores"};
  }
  return {};
}

}  // namespace

class Server::Impl {
 public:
  struct Made {
    Endpoint endpoint;
    std::unique_ptr<Service> service;
    std::unique_ptr<Spool> spool;
    std::unique_ptr<EventQueue> events;
    TransportPlan plan;
    std::string instance;
  };

  Impl(const ServeConfig& config, Clock now, Made made)
      : endpoint_(std::move(made.endpoint)),
        service_(std::move(made.service)),
        spool_(std::move(made.spool)),
        events_(std::move(made.events)),
        stores_(*service_, {config.stores_directory, config.max_stores, to_millis(config.idle_seconds)}, now),
        jobs_(config.max_jobs, stores_, *spool_, *events_),
        desk_(config.stores_directory, stores_, *spool_, *events_),
        context_(1),
        socket_(context_, zmq::socket_type::router),
        dispatcher_(
            {.max_connections = config.max_connections,
             .chunk_rays = made.plan.chunk_rays,
             .silence = to_millis(config.silence_seconds),
             .instance = instance_number(made.instance)},
            jobs_, desk_,
            [this](const std::string& id, const pb::ServerMessage& message, std::optional<Frame> frame) {
              return send_packet(socket_, id, message, std::move(frame));
            },
            now) {
    socket_.set(zmq::sockopt::router_mandatory, true);
    socket_.set(zmq::sockopt::linger, kLingerMillis);
    socket_.set(zmq::sockopt::rcvhwm, kReceiveQueueMessages);
    socket_.set(zmq::sockopt::sndhwm, kSendQueueMessages);
    socket_.set(zmq::sockopt::maxmsgsize, static_cast<std::int64_t>(made.plan.chunk_rays * sizeof(Ray)));
    // Only where asked for: an IPv6 socket shows 127.0.0.1 as [::ffff:127.0.0.1].
    socket_.set(zmq::sockopt::ipv6, endpoint_.address().starts_with("tcp://["));
  }

  Status bind() {
    if (zmq_bind(socket_.handle(), endpoint_.address().c_str()) != 0) {
      const int error = zmq_errno();
      return {error == EADDRINUSE ? ErrorCode::busy_retry : ErrorCode::io,
              "cannot bind " + endpoint_.address() + ": " + zmq_strerror(error)};
    }
    bound_ = socket_.get(zmq::sockopt::last_endpoint);
    return endpoint_.restrict_access();
  }

  Status run();
  void stop() {
    stopping_.store(true, std::memory_order_release);
    events_->wake();
  }
  [[nodiscard]] const std::string& bound() const { return bound_; }
  [[nodiscard]] ServerStats stats() const {
    const std::lock_guard lock(stats_mutex_);
    return stats_;
  }

 private:
  static std::uint64_t instance_number(const std::string& instance) {
    std::uint64_t number = 0;
    std::from_chars(instance.data(), instance.data() + instance.size(), number, 16);
    return number;
  }
  void receive_messages();
  void publish_stats();

  // In the order of their need: what stands below uses what stands above.
  Endpoint endpoint_;
  std::unique_ptr<Service> service_;
  std::unique_ptr<Spool> spool_;
  std::unique_ptr<EventQueue> events_;
  StoreTable stores_;
  JobTable jobs_;
  Desk desk_;
  zmq::context_t context_;
  zmq::socket_t socket_;
  Dispatcher dispatcher_;

  std::string bound_;
  std::atomic<bool> stopping_ = false;
  std::uint64_t malformed_ = 0;
  mutable std::mutex stats_mutex_;
  ServerStats stats_;
};

Status Server::Impl::run() {
  bool told = false;
  while (!told || jobs_.running() > 0) {
    const auto wait = std::clamp(stores_.close_idle(), std::chrono::milliseconds(10), std::chrono::milliseconds(250));
    zmq::pollitem_t items[] = {{socket_.handle(), 0, ZMQ_POLLIN, 0}, {nullptr, events_->descriptor(), ZMQ_POLLIN, 0}};
    if (zmq_poll(items, 2, static_cast<long>(wait.count())) < 0 && zmq_errno() != EINTR) {
      return {ErrorCode::internal, std::string("the server cannot wait for messages: ") + zmq_strerror(zmq_errno())};
    }
    receive_messages();
    for (Event& event : events_->take()) {
      dispatcher_.handle(std::move(event));
    }
    if (stopping_.load(std::memory_order_acquire) && !told) {
      dispatcher_.shut_down();
      told = true;
    }
    dispatcher_.tick();
    publish_stats();
  }
  return {};
}

void Server::Impl::receive_messages() {
  ReceivedParts received;
  for (int i = 0; i < kMessagesPerTurn && receive_parts(socket_, received); ++i) {
    if (received.count == 0) {
      ++malformed_;
      continue;
    }
    const std::string sender = received.parts[0].to_string();
    if (received.count == 1 || received.too_many) {
      ++malformed_;
      dispatcher_.refuse(sender, {ErrorCode::corrupt, "a message has one part, and a raw frame where one belongs"});
      continue;
    }
    std::optional<Frame> frame;
    if (received.count == 3) {
      frame.emplace(std::move(received.parts[2]));
    }
    dispatcher_.receive(sender, bytes_of(std::as_const(received.parts[1])), std::move(frame));
  }
}

void Server::Impl::publish_stats() {
  const std::lock_guard lock(stats_mutex_);
  stats_ = {.messages = dispatcher_.stats(),
            .malformed = malformed_,
            .connections = dispatcher_.connections(),
            .jobs_known = jobs_.all().size(),
            .jobs_running = jobs_.running(),
            .stores_open = stores_.open_count()};
}

Result<std::unique_ptr<Server>> Server::start(const ServeConfig& config, ServerParts parts) {
  RAYMILL_RETURN_IF_ERROR(check(config));
  RAYMILL_ASSIGN_OR_RETURN(Endpoint endpoint, Endpoint::claim(config.bind));
  const TransportPlan plan = plan_transport(config.memory, config.max_jobs, config.max_connections);
  if (plan.bytes >= config.memory) {
    return {ErrorCode::budget_exceeded, "messages alone need " + storage::format_bytes(plan.bytes) + " of the " +
                                            storage::format_bytes(config.memory) +
                                            " given; give more memory, or fewer jobs or connections"};
  }
  RAYMILL_ASSIGN_OR_RETURN(std::unique_ptr<Service> service,
                           parts.make_service({.memory = config.memory - plan.bytes,
                                               .threads = config.threads,
                                               .isa = config.isa,
                                               .io = config.io,
                                               .max_jobs = config.max_jobs,
                                               .max_stores = config.max_stores,
                                               .spill_directory = config.spill_directory}));
  std::string instance = random_id();
  RAYMILL_ASSIGN_OR_RETURN(std::unique_ptr<Spool> spool, Spool::create(config.spool_directory, instance));
  RAYMILL_ASSIGN_OR_RETURN(std::unique_ptr<EventQueue> events, EventQueue::create());
  std::unique_ptr<Impl> impl;
  try {
    impl = std::make_unique<Impl>(config, parts.now,
                                  Impl::Made{std::move(endpoint), std::move(service), std::move(spool),
                                             std::move(events), plan, std::move(instance)});
  } catch (const std::exception& error) {  // zmq::error_t, std::system_error: no descriptors, no threads
    return {ErrorCode::io, std::string("the server cannot start: ") + error.what()};
  }
  RAYMILL_RETURN_IF_ERROR(impl->bind());
  return std::unique_ptr<Server>(new Server(std::move(impl)));
}

Server::Server(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Server::~Server() = default;
const std::string& Server::endpoint() const { return impl_->bound(); }
Status Server::run() { return impl_->run(); }
void Server::stop() { impl_->stop(); }
ServerStats Server::stats() const { return impl_->stats(); }

}  // namespace raymill::server
