// The part of the Dispatcher that concerns jobs: what clients ask about them, and what their threads report.
#include <cstring>
#include <memory>
#include <utility>
#include <vector>

#include "server/dispatcher.h"
#include "server/limits.h"
#include "server/store_names.h"
#include "storage/base/checksum.h"

namespace raymill::server {

namespace {

Status no_such_job(const std::string& id) {
  return {ErrorCode::not_found,
          "no job " + id + " on this server; it has ended, was dropped, or the server was started anew"};
}

}  // namespace

Status Dispatcher::may_start(const Request& request, const pb::StartJob& start) const {
  if (shutting_down_) {
    return {ErrorCode::unavailable, "the server is shutting down"};
  }
  if (!request.connection.job.empty()) {
    return {ErrorCode::busy_retry, "this connection has an unfinished job; open another connection for another job"};
  }
  if (!start.detached() && start.rows_limit() == 0) {
    return {ErrorCode::invalid_argument, "a job whose client accepts no rows would never end; give a rows_limit"};
  }
  if (start.detached() && gives_lists(from_wire(start.query()))) {
    return {ErrorCode::unsupported,
            "submitted jobs answer each ray by one row; trace lists (all, spans) with --server"};
  }
  return {};
}

void Dispatcher::start_job(const Request& request, const pb::StartJob& start, const std::optional<Frame>& masks) {
  auto store = canonical_store_name(start.store());
  if (const Status refused = store.ok() ? may_start(request, start) : store.status(); !refused.ok()) {
    reply_error(request.id, request.sequence, refused);
    return;
  }
  const bool brings = start.skips() || start.masks();
  JobSpec spec{.id = {},
               .store = std::move(*store),
               .trace = to_trace_config(start),
               .detached = start.detached(),
               .chunk_rays = config_.chunk_rays / ((brings ? 2 : 1) * (start.float64() ? 2 : 1)),
               .rows_limit = std::min(start.rows_limit(), kRowsWindow)};
  spec.trace.fields = answered_fields(spec.trace.query, spec.trace.fields);
  if (masks) {
    std::vector<std::uint32_t> copy(start.geometry_masks());
    std::memcpy(copy.data(), masks->data(), copy.size() * sizeof(std::uint32_t));
    spec.trace.geometry_masks = std::make_shared<const std::vector<std::uint32_t>>(std::move(copy));
  }
  auto job = jobs_.add(std::move(spec), request.id);
  if (!job.ok()) {
    reply_error(request.id, request.sequence, job.status());
    return;
  }
  JobRecord& record = **job;
  request.connection.job = record.spec.id;
  pb::ServerMessage answer;
  pb::JobAccepted& accepted = *answer.mutable_job_accepted();
  *accepted.mutable_job() = record.info();
  accepted.set_chunk_rays(record.spec.chunk_rays);
  accepted.set_chunk_limit(record.chunk_limit());
  accepted.set_float64(record.spec.trace.float64);
  reply(request.id, request.sequence, answer);
}

JobRecord* Dispatcher::own_job(const Request& request, const std::string& id) {
  JobRecord* job = jobs_.find(id);
  if (job == nullptr) {
    reply_error(request.id, request.sequence, no_such_job(id), id);
    return nullptr;
  }
  if (job->owner != request.id) {
    reply_error(request.id, request.sequence,
                {ErrorCode::unauthorised, "job " + id + " belongs to another connection, or its upload is finished"},
                id);
    return nullptr;
  }
  return job;
}

void Dispatcher::take_chunk(const Request& request, const pb::Chunk& chunk, Frame frame) {
  JobRecord* job = own_job(request, chunk.job());
  if (job == nullptr) {
    return;
  }
  const auto refuse_chunk = [&](ErrorCode code, const std::string& sentence) {
    reply_error(request.id, request.sequence, {code, "chunk " + std::to_string(chunk.index()) + " " + sentence},
                chunk.job());
  };
  if (chunk.index() < job->received_chunks) {
    ++stats_.chunks_duplicated;
    send_credit(*job, request.sequence);
    return;
  }
  if (job->upload_finished) {
    return refuse_chunk(ErrorCode::invalid_argument, "comes after the job was finished");
  }
  if (chunk.index() > job->received_chunks) {
    return refuse_chunk(ErrorCode::invalid_argument,
                        "leaves a gap: chunk " + std::to_string(job->received_chunks) + " is expected");
  }
  if (chunk.index() >= std::min(job->chunk_limit(), kMostChunksPerJob)) {
    return refuse_chunk(ErrorCode::busy_retry,
                        "comes without credit; chunks below " + std::to_string(job->chunk_limit()) + " may be sent");
  }
  if (chunk.rays() > job->spec.chunk_rays) {
    return refuse_chunk(ErrorCode::invalid_argument, "has " + std::to_string(chunk.rays()) + " rays, more than the " +
                                                         std::to_string(job->spec.chunk_rays) + " of this job");
  }
  if (const std::size_t each = ray_bytes(job->spec.trace); frame.size() != each * chunk.rays()) {
    return refuse_chunk(ErrorCode::bad_rays, "has " + std::to_string(frame.size()) + " bytes for " +
                                                 std::to_string(chunk.rays()) + " rays, which take " +
                                                 std::to_string(each) + " each with what the job was asked for");
  }
  if (chunk.checksum() != storage::checksum(bytes_of(frame))) {
    return refuse_chunk(ErrorCode::checksum_mismatch, "was damaged on its way; send it again");
  }
  ++job->received_chunks;
  job->rays += chunk.rays();
  job->runner->offer(std::move(frame));
  send_credit(*job, request.sequence);
}

void Dispatcher::send_credit(const JobRecord& job, std::uint64_t sequence) {
  if (job.owner.empty()) {
    return;
  }
  pb::ServerMessage message;
  pb::Credit& credit = *message.mutable_credit();
  credit.set_job(job.spec.id);
  credit.set_received(job.received_chunks);
  credit.set_limit(job.chunk_limit());
  credit.set_rays_done(job.rays_done());
  reply(job.owner, sequence, message);
}

void Dispatcher::finish_job(const Request& request, const pb::FinishJob& finish) {
  JobRecord* job = own_job(request, finish.job());
  if (job == nullptr) {
    return;
  }
  if (finish.chunks() != job->received_chunks || finish.rays() != job->rays) {
    reply_error(request.id, request.sequence,
                {ErrorCode::invalid_argument,
                 "the job has " + std::to_string(job->received_chunks) + " chunks and " + std::to_string(job->rays) +
                     " rays here, not " + std::to_string(finish.chunks()) + " and " + std::to_string(finish.rays())},
                finish.job());
    return;
  }
  job->upload_finished = true;
  if (job->runner) {
    job->runner->finish();
  }
  if (job->spec.detached) {
    // From here on it needs no client.
    job->owner.clear();
    request.connection.job.clear();
  }
  pb::ServerMessage answer;
  *answer.mutable_job_reply()->mutable_job() = job->info();
  reply(request.id, request.sequence, answer);
}

void Dispatcher::accept_rows(const Request& request, const pb::AcceptRows& accept) {
  JobRecord* job = own_job(request, accept.job());
  if (job == nullptr || !job->runner) {
    return;
  }
  job->runner->accept_rows(accept.limit());
}

void Dispatcher::cancel_job(const Request& request, const std::string& id) {
  JobRecord* job = jobs_.find(id);
  if (job == nullptr) {
    reply_error(request.id, request.sequence, no_such_job(id), id);
    return;
  }
  if (!job->spec.detached && job->owner != request.id) {
    reply_error(request.id, request.sequence,
                {ErrorCode::unauthorised, "job " + id + " belongs to another client, which alone may cancel it"}, id);
    return;
  }
  const std::string asker = request.id;
  const std::uint64_t sequence = request.sequence;
  const bool had_ended = job->ended();
  jobs_.cancel(*job, {ErrorCode::cancelled, "the job was cancelled"});
  pb::ServerMessage answer;
  *answer.mutable_job_reply()->mutable_job() = job->info();
  if (had_ended) {
    jobs_.erase(id);
  } else if (job->ended()) {
    close_job(*job, {});
  }
  reply(asker, sequence, answer);
}

void Dispatcher::get_job(const Request& request, const std::string& id) {
  const JobRecord* job = jobs_.find(id);
  if (job == nullptr) {
    reply_error(request.id, request.sequence, no_such_job(id), id);
    return;
  }
  pb::ServerMessage answer;
  *answer.mutable_job_reply()->mutable_job() = job->info();
  reply(request.id, request.sequence, answer);
}

void Dispatcher::list_jobs(const Request& request) {
  pb::ServerMessage answer;
  pb::JobList& list = *answer.mutable_job_list();
  for (const auto& [id, job] : jobs_.all()) {
    *list.add_jobs() = job.info();
  }
  reply(request.id, request.sequence, answer);
}

void Dispatcher::fetch_rows(const Request& request, const pb::FetchRows& fetch) {
  const JobRecord* job = jobs_.find(fetch.job());
  Status refused;
  if (job == nullptr) {
    refused = no_such_job(fetch.job());
  } else if (!job->spec.detached) {
    refused = {ErrorCode::invalid_argument, "the rows of job " + fetch.job() + " go to the client that traces it"};
  } else if (!job->ended()) {
    refused = {ErrorCode::busy_retry, "job " + fetch.job() + " is not done yet"};
  } else if (!job->end.ok()) {
    refused = job->end;
  } else if (fetch.first_row() > job->total_rows) {
    refused = {ErrorCode::invalid_argument, "the job has " + std::to_string(job->total_rows) + " rows"};
  }
  if (!refused.ok()) {
    reply_error(request.id, request.sequence, refused, fetch.job());
    return;
  }
  ask_desk(request, FetchTask{fetch.job(), job->spec.trace.fields, fetch.first_row(), job->total_rows});
}

void Dispatcher::handle_job(JobEvent&& event) {
  JobRecord* job = jobs_.find(event.job);
  if (job == nullptr) {
    return;
  }
  if (std::holds_alternative<RunStarted>(event.what)) {
    job->started = true;
    send_credit(*job, 0);
  } else if (std::holds_alternative<ChunkTaken>(event.what)) {
    ++job->taken_chunks;
    if (!job->upload_finished) {
      send_credit(*job, 0);
    }
  } else if (auto* rows = std::get_if<RowsReady>(&event.what)) {
    if (job->owner.empty() || !job->end.ok()) {
      return;
    }
    pb::ServerMessage message;
    pb::Rows& wire = *message.mutable_rows();
    wire.set_job(event.job);
    wire.set_index(rows->index);
    wire.set_first_ray(rows->first_ray);
    wire.set_rows(rows->rows);
    wire.set_rays(rows->rays);
    wire.set_goes_on(rows->goes_on);
    wire.set_checksum(rows->checksum);
    reply(job->owner, 0, message, std::move(rows->frame));
  } else if (auto* end = std::get_if<RunEnded>(&event.what)) {
    const JobStats stats = std::move(end->stats);
    jobs_.ended(*job, std::move(*end));
    close_job(*job, stats);
  }
}

void Dispatcher::close_job(JobRecord& job, const JobStats& stats) {
  if (!job.owner.empty()) {
    pb::ServerMessage message;
    pb::JobEnded& ended = *message.mutable_job_ended();
    ended.set_job(job.spec.id);
    ended.set_code(static_cast<std::uint32_t>(job.end.code()));
    ended.set_message(cut_sentence(job.end.message()));
    *ended.mutable_stats() = to_wire(stats);
    reply(job.owner, 0, message);
    if (const auto found = connections_.find(job.owner); found != connections_.end()) {
      found->second.job.clear();
    }
    job.owner.clear();
  }
  if (!job.spec.detached || job.drop_at_end) {
    jobs_.erase(job.spec.id);
  }
}

}  // namespace raymill::server
