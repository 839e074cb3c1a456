// The part of Client that concerns submitted jobs: those that go on at the server without this client.
#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>
#include <vector>

#include "client/cpp/client_impl.h"
#include "client/cpp/job_link.h"
#include "server/limits.h"
#include "storage/base/checksum.h"

namespace raymill {

namespace pb = client::pb;

namespace {

/// How often wait() asks: soon at first, then at most so often.
constexpr std::chrono::milliseconds kFirstPoll{5};
constexpr std::chrono::milliseconds kLongestPoll{500};

JobState from_wire(pb::JobState state) {
  switch (state) {
    case pb::JOB_STATE_RUNNING:
      return JobState::running;
    case pb::JOB_STATE_DONE:
      return JobState::done;
    case pb::JOB_STATE_FAILED:
      return JobState::failed;
    case pb::JOB_STATE_CANCELLED:
      return JobState::cancelled;
    default:
      return JobState::queued;  // the others do not pass decode()
  }
}

JobInfo from_wire(const pb::JobInfo& wire) {
  return {.id = wire.id(),
          .store = wire.store(),
          .state = from_wire(wire.state()),
          .query = server::from_wire(wire.query()),
          .mode = server::from_wire(wire.mode()),
          .fields = Field(wire.fields()),
          .rays = wire.rays(),
          .rays_done = wire.rays_done(),
          .detached = wire.detached(),
          .message = wire.message()};
}

}  // namespace

namespace {

Status push(client::JobLink& link, std::span<const Ray> rays) { return link.push(rays); }
Status push(client::JobLink& link, std::span<const Ray64> rays) { return link.push64(rays); }

template <typename AnyRay>
Result<std::string> submit_any(const client::Session& session, const std::string& store, const TraceConfig& config,
                               const std::function<Result<std::size_t>(std::span<AnyRay>)>& rays) {
  RAYMILL_ASSIGN_OR_RETURN(
      const std::unique_ptr<client::JobLink> link,
      client::JobLink::start(session.context, session.config, {.store = store, .trace = config, .detached = true}));
  std::vector<AnyRay> batch(link->chunk_rays());
  while (true) {
    RAYMILL_ASSIGN_OR_RETURN(const std::size_t count, rays(batch));
    if (count > batch.size()) {
      return {ErrorCode::invalid_argument, "the source of rays wrote more of them than there was room for"};
    }
    if (count == 0) {
      break;
    }
    RAYMILL_RETURN_IF_ERROR(push(*link, std::span<const AnyRay>(batch).first(count)));
  }
  RAYMILL_RETURN_IF_ERROR(link->finish());
  return link->id();
}

}  // namespace

Result<std::string> Client::submit(const std::string& store, const TraceConfig& config,
                                   const std::function<Result<std::size_t>(std::span<Ray>)>& rays) {
  return submit_any(*impl_->session, store, config, rays);
}

Result<std::string> Client::submit64(const std::string& store, const TraceConfig& config,
                                     const std::function<Result<std::size_t>(std::span<Ray64>)>& rays) {
  TraceConfig wide = config;
  wide.float64 = true;
  return submit_any(*impl_->session, store, wide, rays);
}

Result<JobInfo> Client::job(const std::string& id) {
  pb::ClientMessage message;
  message.mutable_get_job()->set_job(id);
  RAYMILL_ASSIGN_OR_RETURN(const client::ServerPacket answer,
                           impl_->session->ask(std::move(message), pb::ServerMessage::kJobReply));
  return from_wire(answer.message.job_reply().job());
}

Result<std::vector<JobInfo>> Client::jobs() {
  pb::ClientMessage message;
  message.mutable_list_jobs();
  RAYMILL_ASSIGN_OR_RETURN(const client::ServerPacket answer,
                           impl_->session->ask(std::move(message), pb::ServerMessage::kJobList));
  std::vector<JobInfo> jobs;
  for (const pb::JobInfo& job : answer.message.job_list().jobs()) {
    jobs.push_back(from_wire(job));
  }
  return jobs;
}

Result<JobInfo> Client::wait(const std::string& id, double timeout_seconds) {
  const auto start = std::chrono::steady_clock::now();
  auto pause = kFirstPoll;
  while (true) {
    RAYMILL_ASSIGN_OR_RETURN(JobInfo info, job(id));
    if (info.state != JobState::queued && info.state != JobState::running) {
      return info;
    }
    const std::chrono::duration<double> waited = std::chrono::steady_clock::now() - start;
    if (timeout_seconds > 0 && waited.count() >= timeout_seconds) {
      return {ErrorCode::busy_retry, "job " + id + " is still " + std::string(to_string(info.state)) + "; wait longer"};
    }
    std::this_thread::sleep_for(pause);
    pause = std::min(pause * 2, kLongestPoll);
  }
}

Status Client::fetch(const std::string& id,
                     const std::function<Status(const HitLayout&, std::uint64_t total_rays)>& begin,
                     const std::function<Status(std::span<const std::byte>)>& rows) {
  std::uint64_t first_row = 0;
  std::uint64_t total_rows = 0;
  HitLayout layout;
  for (bool begun = false; !begun || first_row < total_rows;) {
    pb::ClientMessage message;
    message.mutable_fetch_rows()->set_job(id);
    message.mutable_fetch_rows()->set_first_row(first_row);
    RAYMILL_ASSIGN_OR_RETURN(const client::ServerPacket answer,
                             impl_->session->ask_disk(std::move(message), pb::ServerMessage::kFetchedRows));
    const pb::FetchedRows& header = answer.message.fetched_rows();
    if (!begun) {
      layout = HitLayout(Field(header.fields()));
      total_rows = header.total_rows();
      RAYMILL_RETURN_IF_ERROR(begin(layout, total_rows));
      begun = true;
    }
    const auto bytes = server::bytes_of(*answer.frame);
    const bool whole = bytes.size() == header.rows() * layout.row_bytes() && header.first_row() == first_row &&
                       header.total_rows() == total_rows && Field(header.fields()) == layout.fields() &&
                       header.rows() <= total_rows - first_row && (header.rows() > 0 || first_row == total_rows);
    if (!whole) {
      return {ErrorCode::corrupt, "the server sent rows of job " + id + " out of their order or size"};
    }
    if (storage::checksum(bytes) != header.checksum()) {
      return {ErrorCode::checksum_mismatch, "rows of job " + id + " were damaged on their way; fetch them again"};
    }
    if (!bytes.empty()) {
      RAYMILL_RETURN_IF_ERROR(rows(bytes));
    }
    first_row += header.rows();
  }
  return {};
}

Status Client::cancel(const std::string& id) {
  pb::ClientMessage message;
  message.mutable_cancel_job()->set_job(id);
  return impl_->session->ask(std::move(message), pb::ServerMessage::kJobReply).status();
}

}  // namespace raymill
