#include "client/cpp/job_link.h"

#include <algorithm>
#include <cstring>
#include <type_traits>
#include <utility>
#include <vector>

#include "server/limits.h"
#include "server/list_frames.h"
#include "storage/base/checksum.h"

namespace raymill::client {

namespace {

/// Keeps the frame that a HitChunk's rows lie in.
class FrameOwner final : public HitChunk::Owner {
 public:
  FrameOwner(Frame frame, std::vector<std::uint32_t> offsets)
      : frame_(std::move(frame)), offsets_(std::move(offsets)) {}
  [[nodiscard]] std::span<const std::byte> rows() const {
    return server::bytes_of(frame_).subspan(offsets_.size() * sizeof(std::uint32_t));
  }
  [[nodiscard]] std::span<const std::uint32_t> offsets() const { return offsets_; }

 private:
  Frame frame_;
  std::vector<std::uint32_t> offsets_;  // of lists
};

// Masks of geometries as they travel; none where there are none.
Result<std::optional<Frame>> masks_frame(const TraceConfig& config) {
  if (!config.geometry_masks || config.geometry_masks->empty()) {
    return std::optional<Frame>();
  }
  const auto& masks = *config.geometry_masks;
  if (masks.size() > server::kMostGeometryMasks) {
    return {ErrorCode::unsupported, "a server takes masks of " + std::to_string(server::kMostGeometryMasks) +
                                        " geometries at most, not of " + std::to_string(masks.size()) +
                                        "; trace on this machine, by an Engine or without --server"};
  }
  return std::optional<Frame>(std::in_place, masks.data(), masks.size() * sizeof(std::uint32_t));
}

}  // namespace

Result<std::unique_ptr<JobLink>> JobLink::start(std::shared_ptr<zmq::context_t> context, const ClientConfig& config,
                                                const JobRequest& request) {
  if (request.trace.tolerance != 0 || request.trace.tolerance_angle != 0) {
    return {
        ErrorCode::unsupported,
        "a server gives no answers within a tolerance; trace them on this machine, by an Engine or without --server"};
  }
  RAYMILL_ASSIGN_OR_RETURN(std::optional<Frame> masks, masks_frame(request.trace));
  std::unique_ptr<JobLink> link(new JobLink);
  Handlers handlers{.message = [raw = link.get()](ServerPacket&& packet) { raw->on_message(std::move(packet)); },
                    .lost = [raw = link.get()](const Status& status) { raw->end(status); }};
  RAYMILL_ASSIGN_OR_RETURN(link->connection_, Connection::open(std::move(context), config, std::move(handlers)));

  pb::ClientMessage message;
  pb::StartJob& start = *message.mutable_start_job();
  start.set_store(request.store);
  server::fill(request.trace, start);
  start.set_detached(request.detached);
  start.set_rows_limit(server::kRowsWindow);
  RAYMILL_ASSIGN_OR_RETURN(const ServerPacket answer, link->connection_->call(std::move(message), std::move(masks)));
  if (!answer.message.has_job_accepted()) {
    return {ErrorCode::corrupt, config.address + " answered a request for a job with something else"};
  }
  const pb::JobAccepted& accepted = answer.message.job_accepted();
  if (request.trace.float64 && !accepted.float64()) {
    return {ErrorCode::unsupported,
            config.address +
                " is a server of an older version, which takes no rays of float64; round them relative to "
                "StoreInfo::origin and ask for TraceConfig::relative, or renew the server"};
  }
  const std::lock_guard lock(link->mutex_);
  link->id_ = accepted.job().id();
  link->layout_ = HitLayout(Field(accepted.job().fields()));
  link->lists_ = gives_lists(request.trace.query);
  link->config_ = request.trace;
  link->config_.geometry_masks = {};  // which are sent
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

Status JobLink::check(std::size_t rays, const RayExtras& extras) const {
  const auto fits = [rays](std::size_t count, bool asked) { return count == 0 || (asked && count == rays); };
  if (!fits(extras.skipped.size(), config_.skips) || !fits(extras.masks.size(), config_.masks)) {
    return {ErrorCode::invalid_argument,
            "rays bring primitives to skip or masks where the job was asked for them (TraceConfig), one for each ray"};
  }
  return {};
}

namespace {

Ray64 widened(const Ray& ray) {
  return {.org = {ray.org[0], ray.org[1], ray.org[2]},
          .tnear = ray.tnear,
          .dir = {ray.dir[0], ray.dir[1], ray.dir[2]},
          .tfar = ray.tfar};
}

}  // namespace

// Rays that there is place for; what they do not bring is that they skip nothing and have all bits.
template <typename AnyRay>
void JobLink::fill_chunk(std::span<const AnyRay> rays, const RayExtras& extras) {
  if (!chunk_) {
    chunk_.emplace(chunk_rays_ * server::ray_bytes(config_));
    chunk_fill_ = 0;
  }
  std::byte* part = server::bytes_of(*chunk_).data();
  const auto put = [&]<typename T>(std::span<const T> values, const T& none) {
    std::byte* at = part + chunk_fill_ * sizeof(T);
    for (std::size_t i = 0; i < rays.size() && values.empty(); ++i) {
      std::memcpy(at + i * sizeof(T), &none, sizeof(T));
    }
    if (!values.empty()) {
      std::memcpy(at, values.data(), rays.size() * sizeof(T));
    }
    part += chunk_rays_ * sizeof(T);
  };
  if constexpr (std::is_same_v<AnyRay, Ray>) {
    if (config_.float64) {
      for (std::size_t i = 0; i < rays.size(); ++i) {
        const Ray64 wide = widened(rays[i]);
        std::memcpy(part + (chunk_fill_ + i) * sizeof wide, &wide, sizeof wide);
      }
      part += chunk_rays_ * sizeof(Ray64);
    } else {
      put(rays, Ray());
    }
  } else {
    put(rays, Ray64());
  }
  if (config_.skips) {
    put(extras.skipped, PrimitiveIds());
  }
  if (config_.masks) {
    put(extras.masks, kAllMask);
  }
  chunk_fill_ += rays.size();
}

// The chunk as it travels. One that is not full is the last one: its parts move together, and frames cannot shrink.
Frame JobLink::take_chunk() {
  Frame full = std::move(*chunk_);
  chunk_.reset();
  const std::size_t rays = std::exchange(chunk_fill_, 0);
  if (rays == chunk_rays_) {
    return full;
  }
  Frame frame(rays * server::ray_bytes(config_));
  const std::byte* from = server::bytes_of(full).data();
  std::byte* to = server::bytes_of(frame).data();
  for (const std::size_t each : {config_.float64 ? sizeof(Ray64) : sizeof(Ray),
                                 config_.skips ? sizeof(PrimitiveIds) : 0, config_.masks ? sizeof(std::uint32_t) : 0}) {
    std::memcpy(to, from, rays * each);
    to += rays * each;
    from += chunk_rays_ * each;
  }
  return frame;
}

Status JobLink::push(std::span<const Ray> rays, const RayExtras& extras) { return push_any(rays, extras); }

Status JobLink::push64(std::span<const Ray64> rays, const RayExtras& extras) {
  if (!config_.float64) {
    return {ErrorCode::invalid_argument, "the job was not asked for rays of float64 (TraceConfig::float64)"};
  }
  return push_any(rays, extras);
}

template <typename AnyRay>
Status JobLink::push_any(std::span<const AnyRay> rays, const RayExtras& extras) {
  if (finished_) {
    return {ErrorCode::invalid_argument, "rays were pushed after finish()"};
  }
  RAYMILL_RETURN_IF_ERROR(check(rays.size(), extras));
  RAYMILL_RETURN_IF_ERROR(status());
  for (std::size_t at = 0; at < rays.size();) {
    const std::size_t count = std::min<std::size_t>(rays.size() - at, chunk_rays_ - chunk_fill_);
    RayExtras bring;
    bring.skipped = extras.skipped.empty() ? extras.skipped : extras.skipped.subspan(at, count);
    bring.masks = extras.masks.empty() ? extras.masks : extras.masks.subspan(at, count);
    fill_chunk(rays.subspan(at, count), bring);
    at += count;
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
  pb::ClientMessage message;
  pb::Chunk& chunk = *message.mutable_chunk();
  chunk.set_job(id_);
  chunk.set_index(chunks_sent_++);
  chunk.set_rays(chunk_fill_);
  Frame frame = take_chunk();
  chunk.set_checksum(storage::checksum(server::bytes_of(std::as_const(frame))));
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
    if (rays_read_ != rays_pushed_) {
      end_status_ = {ErrorCode::corrupt, "the server answered " + std::to_string(rays_read_) + " of " +
                                             std::to_string(rays_pushed_) + " rays"};
    }
    return std::nullopt;
  }
  ReceivedRows rows = std::move(rows_.front());
  rows_.pop_front();
  lock.unlock();

  Result<HitChunk> given = chunk_of(std::move(rows));
  if (!given.ok()) {
    lock.lock();
    ended_ = true;
    end_status_ = given.status();
    lock.unlock();
    pb::ClientMessage message;
    message.mutable_cancel_job()->set_job(id_);
    connection_->post(std::move(message));
    return std::nullopt;
  }
  pb::ClientMessage message;
  message.mutable_accept_rows()->set_job(id_);
  message.mutable_accept_rows()->set_limit(messages_read_ + server::kRowsWindow);
  connection_->post(std::move(message));
  lock.lock();
  rays_done_ = std::max(rays_done_, rays_read_);
  lock.unlock();
  return std::move(*given);
}

Result<HitChunk> JobLink::chunk_of(ReceivedRows rows) {
  RAYMILL_RETURN_IF_ERROR(check(rows));
  std::vector<std::uint32_t> offsets;
  if (lists_) {
    RAYMILL_ASSIGN_OR_RETURN(offsets,
                             server::read_offsets(server::bytes_of(std::as_const(rows.frame)), rows.header.rays(),
                                                  rows.header.rows(), layout_.row_bytes()));
  }
  const std::uint64_t first_ray = rays_read_;
  const bool goes_on = lists_ && rows.header.goes_on();
  rays_read_ += lists_ ? rows.header.rays() - (goes_on ? 1 : 0) : rows.header.rows();
  auto owner = std::make_unique<FrameOwner>(std::move(rows.frame), std::move(offsets));
  const auto [bytes, starts] = std::pair(owner->rows(), owner->offsets());
  HitChunk chunk(messages_read_++, first_ray, layout_, bytes, std::move(owner));
  chunk.set_offsets(starts, goes_on);
  return chunk;
}

Status JobLink::check(const ReceivedRows& rows) const {
  const bool fits = lists_ || (rows.header.rows() <= chunk_rays_ && rows.header.rays() == 0 &&
                               rows.frame.size() == rows.header.rows() * layout_.row_bytes());
  if (rows.header.index() != messages_read_ || rows.header.first_ray() != rays_read_ || !fits) {
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
