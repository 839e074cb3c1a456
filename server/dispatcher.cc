#include "server/dispatcher.h"

#include <utility>

#include "server/limits.h"
#include "server/store_names.h"

namespace raymill::server {

Dispatcher::Dispatcher(DispatcherConfig config, JobTable& jobs, Desk& desk, Send send, Clock now)
    : config_(config), jobs_(jobs), desk_(desk), send_(std::move(send)), now_(std::move(now)) {}

void Dispatcher::receive(const std::string& connection, std::span<const std::byte> bytes, std::optional<Frame> frame) {
  ++stats_.messages;
  pb::ClientMessage message;
  const auto frame_bytes = frame ? std::optional(frame->size()) : std::nullopt;
  const Status status = decode(bytes, frame_bytes, message);
  if (!status.ok()) {
    // The job, where the message names one, tells the client whom the refusal concerns.
    reply_error(connection, message.sequence(), status, message.has_chunk() ? message.chunk().job() : std::string());
    return;
  }
  if (message.has_hello()) {
    hello(connection, message);
    return;
  }
  const auto found = connections_.find(connection);
  if (found == connections_.end()) {
    reply_error(connection, message.sequence(),
                {ErrorCode::unavailable,
                 "the server does not know this connection: it was started anew, or heard nothing for too long; "
                 "connect again"});
    return;
  }
  found->second.last_heard = now_();
  dispatch({found->first, found->second, message.sequence()}, message, std::move(frame));
}

void Dispatcher::refuse(const std::string& connection, const Status& status) {
  ++stats_.messages;
  reply_error(connection, 0, status);
}

void Dispatcher::hello(const std::string& id, const pb::ClientMessage& message) {
  if (message.hello().protocol_version() != kProtocolVersion) {
    reply_error(id, message.sequence(),
                {ErrorCode::version_mismatch,
                 "the client speaks version " + std::to_string(message.hello().protocol_version()) +
                     " of the protocol and this server version " + std::to_string(kProtocolVersion) +
                     "; use the same Raymill on both sides"});
    return;
  }
  if (shutting_down_ || (!connections_.contains(id) && connections_.size() >= config_.max_connections)) {
    reply_error(
        id, message.sequence(),
        {ErrorCode::busy_retry, shutting_down_ ? "the server is shutting down"
                                               : "the server has as many connections as it takes (" +
                                                     std::to_string(config_.max_connections) + "); try again later"});
    return;
  }
  connections_[id].last_heard = now_();
  pb::ServerMessage answer;
  pb::Welcome& welcome = *answer.mutable_welcome();
  welcome.set_protocol_version(kProtocolVersion);
  welcome.set_software("raymill");
  welcome.set_instance(config_.instance);
  welcome.set_silence_millis(static_cast<std::uint32_t>(config_.silence.count()));
  reply(id, message.sequence(), answer);
}

void Dispatcher::dispatch(const Request& request, const pb::ClientMessage& message, std::optional<Frame> frame) {
  using Body = pb::ClientMessage;
  switch (message.body_case()) {
    case Body::kGoodbye:
      drop(request.id, "the client left");
      return;
    case Body::kPing: {
      pb::ServerMessage answer;
      pb::Pong& pong = *answer.mutable_pong();
      if (const JobRecord* job = jobs_.find(request.connection.job)) {
        pong.set_job(job->spec.id);
        pong.set_rays_done(job->rays_done());
      }
      reply(request.id, request.sequence, answer);
      return;
    }
    case Body::kOpenStore:
      open_store(request, message.open_store().name(), false);
      return;
    case Body::kDescribeStore:
      open_store(request, message.describe_store().name(), true);
      return;
    case Body::kListStores:
      ask_desk(request, ListTask{});
      return;
    case Body::kStartJob:
      start_job(request, message.start_job(), frame);
      return;
    case Body::kChunk:
      take_chunk(request, message.chunk(), std::move(*frame));
      return;
    case Body::kFinishJob:
      finish_job(request, message.finish_job());
      return;
    case Body::kAcceptRows:
      accept_rows(request, message.accept_rows());
      return;
    case Body::kCancelJob:
      cancel_job(request, message.cancel_job().job());
      return;
    case Body::kGetJob:
      get_job(request, message.get_job().job());
      return;
    case Body::kListJobs:
      list_jobs(request);
      return;
    case Body::kFetchRows:
      fetch_rows(request, message.fetch_rows());
      return;
    case Body::kHello:
    case Body::BODY_NOT_SET:
      return;  // answered before, or refused by decode()
  }
}

void Dispatcher::open_store(const Request& request, const std::string& name, bool describe) {
  auto canonical = canonical_store_name(name);
  if (!canonical.ok()) {
    reply_error(request.id, request.sequence, canonical.status());
    return;
  }
  ask_desk(request, OpenTask{std::move(*canonical), describe});
}

void Dispatcher::ask_desk(const Request& request, decltype(DeskTask::what) what) {
  if (request.connection.desk_busy) {
    reply_error(request.id, request.sequence,
                {ErrorCode::busy_retry, "this connection has a request under way; wait for its answer"});
    return;
  }
  request.connection.desk_busy = true;
  desk_.put({request.id, request.sequence, std::move(what)});
}

void Dispatcher::handle(Event&& event) {
  if (auto* job = std::get_if<JobEvent>(&event)) {
    handle_job(std::move(*job));
    return;
  }
  auto& answer = std::get<DeskEvent>(event);
  const auto found = connections_.find(answer.connection);
  if (found == connections_.end()) {
    return;  // left meanwhile
  }
  found->second.desk_busy = false;
  stats_.refused += answer.reply.has_error() ? 1 : 0;
  reply(answer.connection, answer.reply.sequence(), answer.reply, std::move(answer.frame));
}

void Dispatcher::tick() {
  const TimePoint now = now_();
  for (const auto& [id, connection] : connections_) {
    if (now - connection.last_heard > config_.silence) {
      lost_.push_back(id);
    }
  }
  // drop() may find others gone; each round removes at least one connection.
  while (!lost_.empty()) {
    const std::vector<std::string> lost = std::move(lost_);
    lost_.clear();
    for (const std::string& id : lost) {
      stats_.clients_lost += connections_.contains(id) ? 1 : 0;
      drop(id, "its client is gone");
    }
  }
  if (!shutting_down_) {
    jobs_.admit();
  }
}

void Dispatcher::drop(const std::string& id, const char* why) {
  const auto found = connections_.find(id);
  if (found == connections_.end()) {
    return;
  }
  const std::string job_id = std::move(found->second.job);
  connections_.erase(found);
  if (JobRecord* job = jobs_.find(job_id)) {
    job->owner.clear();
    job->drop_at_end = true;
    jobs_.cancel(*job, {ErrorCode::cancelled, std::string("the job was cancelled: ") + why});
    if (job->ended()) {
      jobs_.erase(job_id);
    }
  }
}

void Dispatcher::shut_down() {
  shutting_down_ = true;
  std::vector<std::string> ids;
  for (const auto& [id, job] : jobs_.all()) {
    ids.push_back(id);
  }
  for (const std::string& id : ids) {
    JobRecord& job = *jobs_.find(id);
    job.drop_at_end = true;
    const bool waited = job.state == pb::JOB_STATE_QUEUED;
    jobs_.cancel(job, {ErrorCode::unavailable, "the server is shutting down"});
    if (waited) {
      close_job(job, {});
    }
  }
}

void Dispatcher::reply(const std::string& id, std::uint64_t sequence, pb::ServerMessage& message,
                       std::optional<Frame> frame) {
  message.set_sequence(sequence);
  if (!send_(id, message, std::move(frame))) {
    lost_.push_back(id);
  }
}

void Dispatcher::reply_error(const std::string& id, std::uint64_t sequence, const Status& status,
                             const std::string& job) {
  ++stats_.refused;
  pb::ServerMessage message;
  set_error(message, status, job);
  reply(id, sequence, message);
}

}  // namespace raymill::server
