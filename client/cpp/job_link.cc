#include "client/cpp/job_link.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "server/limits.h"
#include "storage/base/checksum.h"

namespace raymill::client {

namespace {

/// Keeps the frame that a HitChunk's rows lie in.
class FrameOwner final : public HitChunk::Owner {
 public:
  explicit FrameOwner(Frame frame) : frame_(std::move(frame)) {}
  [[nodiscard]] std::span<const std::byte> bytes() const { return server::bytes_of(frame_); }

 private:
  Frame frame_;
};

}  // namespace

Result<std::unique_ptr<JobLink>> JobLink::start(std::shared_ptr<zmq::context_t> context, const ClientConfig& config,
                                                const JobRequest& request) {
  if (request.trace.query == Query::all || request.trace.query == Query::transmittance || request.trace.skips ||
      request.trace.geometry_masks || request.trace.tolerance != 0 || request.trace.tolerance_angle != 0) {
    return {
        ErrorCode::unsupported,
        "a server answers neither the queries all and transmittance nor rays that skip primitives or have masks, nor "
        "within a tolerance; trace them on this machine, by an Engine or without --server"};
  }
  std::unique_ptr<JobLink> link(new JobLink);
  Handlers handlers{.message = [raw = link.get()](ServerPacket&& packet) { raw->on_message(std::move(packet)); },
                    .lost = [raw = link.get()](const Status& status) { raw->end(status); }};
  RAYMILL_ASSIGN_OR_RETURN(link->connection_, Connection::open(std::move(context), config, std::move(handlers)));

  pb::ClientMessage message;
  pb::StartJob& start = *message.mutable_start_job();
  start.set_store(request.store);
  start.set_query(server::to_wire(request.trace.query));
  start.set_mode(server::to_wire(request.trace.mode));
  start.set_fields(static_cast<std::uint32_t>(request.trace.fields));
  start.set_detached(request.detached);
  start.set_rows_limit(server::kRowsWindow);
  RAYMILL_ASSIGN_OR_RETURN(const ServerPacket answer, link->connection_->call(std::move(message)));
  if (!answer.message.has_job_accepted()) {
    return {ErrorCode::corrupt, config.address + " answered a request for a job with something else"};
  }
  const pb::JobAccepted& accepted = answer.message.job_accepted();
  const std::lock_guard lock(link->mutex_);
  link->id_ = accepted.job().id();
  link->layout_ = HitLayout(Field(accepted.job().fields()));
  link->chunk_rays_ = accepted.chunk_rays();
  link->chunk_limit_ = std::max(link->chunk_limit_, accepted.chunk_limit());
  return link;
}

void JobLink::on_message(ServerPacket&& packet) {
  const pb::ServerMessage& message = packet.message;
  if (message.has_error()) {
    end(server::status_from_wire(message.error().code(), message.error().message()));
    return;
  }
  if (message.has_job_ended() && message.job_ended().code() != 0) {
    end(server::status_from_wire(message.job_ended().code(), message.job_ended().message()));
    return;
  }
  const std::lock_guard lock(mutex_);
  if (message.has_credit()) {
    chunk_limit_ = std::max(chunk_limit_, message.credit().limit());
    rays_done_ = std::max(rays_done_, message.credit().rays_done());
  } else if (message.has_pong()) {
    rays_done_ = std::max(rays_done_, message.pong().rays_done());
  } else if (message.has_job_ended()) {
    ended_ = true;
    stats_ = server::from_wire(message.job_ended().stats());
    rays_done_ = std::max(rays_done_, stats_.rays);
  } else if (message.has_rows() && !ended_) {
    if (rows_.size() >= server::kRowsWindow) {
      ended_ = true;
      end_status_ = {ErrorCode::corrupt, "the server sent more rows than this client accepted"};
    } else {
      rows_.push_back({message.rows(), std::move(*packet.frame)});
    }
  }
  changed_.notify_all();
}

void JobLink::end(const Status& status) {
  {
    const std::lock_guard lock(mutex_);
    // What came whole stays whole, whatever happens to the connection after.
    if (!ended_) {
      ended_ = true;
      end_status_ = status;
      rows_.clear();
    }
  }
  changed_.notify_all();
}

Status JobLink::push(std::span<const Ray> rays) {
  if (finished_) {
    return {ErrorCode::invalid_argument, "rays were pushed after finish()"};
  }
  RAYMILL_RETURN_IF_ERROR(status());
  while (!rays.empty()) {
    if (!chunk_) {
      chunk_.emplace(chunk_rays_ * sizeof(Ray));
      chunk_fill_ = 0;
    }
    const std::size_t count = std::min<std::size_t>(rays.size(), chunk_rays_ - chunk_fill_);
    std::memcpy(server::bytes_of(*chunk_).data() + chunk_fill_ * sizeof(Ray), rays.data(), count * sizeof(Ray));
    chunk_fill_ += count;
    rays = rays.subspan(count);
    if (chunk_fill_ == chunk_rays_) {
      RAYMILL_RETURN_IF_ERROR(send_chunk());
    }
    const std::lock_guard lock(mutex_);
    rays_pushed_ += count;
  }
  return {};
}

Status JobLink::send_chunk() {
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return ended_ || chunks_sent_ < chunk_limit_; });
    if (ended_) {
      return end_status_.ok() ? Status(ErrorCode::corrupt, "the server ended the job before its rays had come")
                              : end_status_;
    }
  }
  // A chunk that is not full is the last one; frames cannot shrink.
  Frame frame = chunk_fill_ == chunk_rays_ ? std::move(*chunk_) : Frame(chunk_->data(), chunk_fill_ * sizeof(Ray));
  pb::ClientMessage message;
  pb::Chunk& chunk = *message.mutable_chunk();
  chunk.set_job(id_);
  chunk.set_index(chunks_sent_++);
  chunk.set_rays(chunk_fill_);
  chunk.set_checksum(storage::checksum(server::bytes_of(std::as_const(frame))));
  chunk_.reset();
  chunk_fill_ = 0;
  connection_->post(std::move(message), std::move(frame));
  return {};
}

Status JobLink::finish() {
  if (finished_) {
    return status();
  }
  if (chunk_fill_ > 0) {
    RAYMILL_RETURN_IF_ERROR(send_chunk());
  }
  finished_ = true;
  RAYMILL_RETURN_IF_ERROR(status());
  pb::ClientMessage message;
  pb::FinishJob& finish = *message.mutable_finish_job();
  finish.set_job(id_);
  finish.set_chunks(chunks_sent_);
  {
    const std::lock_guard lock(mutex_);
    finish.set_rays(rays_pushed_);
  }
  const auto answer = connection_->call(std::move(message));
  if (!answer.ok()) {
    end(answer.status());  // where the job had ended before, its own reason stands
    return status();
  }
  return {};
}

std::optional<HitChunk> JobLink::next() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return ended_ || !rows_.empty(); });
  if (!end_status_.ok()) {
    return std::nullopt;
  }
  if (rows_.empty()) {
    if (rows_read_ != rays_pushed_) {
      end_status_ = {ErrorCode::corrupt, "the server answered " + std::to_string(rows_read_) + " of " +
                                             std::to_string(rays_pushed_) + " rays"};
    }
    return std::nullopt;
  }
  ReceivedRows rows = std::move(rows_.front());
  rows_.pop_front();
  lock.unlock();

  const Status good = check(rows);
  if (!good.ok()) {
    lock.lock();
    ended_ = true;
    end_status_ = good;
    lock.unlock();
    pb::ClientMessage message;
    message.mutable_cancel_job()->set_job(id_);
    connection_->post(std::move(message));
    return std::nullopt;
  }
  const std::uint64_t index = messages_read_++;
  const std::uint64_t first_ray = rows_read_;
  rows_read_ += rows.header.rows();
  pb::ClientMessage message;
  message.mutable_accept_rows()->set_job(id_);
  message.mutable_accept_rows()->set_limit(messages_read_ + server::kRowsWindow);
  connection_->post(std::move(message));
  lock.lock();
  rays_done_ = std::max(rays_done_, rows_read_);
  lock.unlock();
  auto owner = std::make_unique<FrameOwner>(std::move(rows.frame));
  const auto bytes = owner->bytes();
  return HitChunk(index, first_ray, layout_, bytes, std::move(owner));
}

Status JobLink::check(const ReceivedRows& rows) const {
  if (rows.header.index() != messages_read_ || rows.header.first_ray() != rows_read_ ||
      rows.header.rows() > chunk_rays_ || rows.frame.size() != rows.header.rows() * layout_.row_bytes()) {
    return {ErrorCode::corrupt, "the server sent rows out of their order or size"};
  }
  if (storage::checksum(server::bytes_of(rows.frame)) != rows.header.checksum()) {
    return {ErrorCode::checksum_mismatch, "rows from the server were damaged on their way; run the job again"};
  }
  return {};
}

void JobLink::cancel() {
  {
    const std::lock_guard lock(mutex_);
    if (end_status_.ok() && !(ended_ && rows_.empty())) {
      ended_ = true;
      end_status_ = {ErrorCode::cancelled, "the job was cancelled"};
      rows_.clear();
    }
  }
  changed_.notify_all();
  pb::ClientMessage message;
  message.mutable_cancel_job()->set_job(id_);
  connection_->post(std::move(message));
}

Status JobLink::status() const {
  const std::lock_guard lock(mutex_);
  return end_status_;
}

JobProgress JobLink::progress() const {
  const std::lock_guard lock(mutex_);
  return {.rays_pushed = rays_pushed_, .rays_done = rays_done_};
}

JobStats JobLink::stats() const {
  const std::lock_guard lock(mutex_);
  JobStats stats = stats_;
  stats.rays = std::max(stats.rays, rays_done_);
  return stats;
}

}  // namespace raymill::client
