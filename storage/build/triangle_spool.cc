#include "storage/build/triangle_spool.h"

#include <algorithm>
#include <new>
#include <utility>

namespace raymill::storage {

Status TriangleSpool::add(std::span<const Triangle> triangles) {
  if (!own_thread_) {
    return write(triangles);
  }
  while (!triangles.empty()) {
    filling_.reserve(kPieceTriangles);
    const std::size_t taken = std::min(kPieceTriangles - filling_.size(), triangles.size());
    filling_.insert(filling_.end(), triangles.begin(), triangles.begin() + static_cast<std::ptrdiff_t>(taken));
    triangles = triangles.subspan(taken);
    if (filling_.size() == kPieceTriangles) {
      RAYMILL_RETURN_IF_ERROR(hand_over());
    }
  }
  return {};
}

Status TriangleSpool::hand_over() {
  if (!thread_.joinable()) {
    thread_ = std::thread([this] { run(); });
  }
  std::unique_lock lock(mutex_);
  waiting_changed_.wait(lock, [this] { return waiting_.size() < kPieces || !failure_.ok(); });
  RAYMILL_RETURN_IF_ERROR(failure_);
  waiting_.push_back(std::move(filling_));
  filling_ = {};
  if (!spare_.empty()) {
    filling_ = std::move(spare_.back());
    spare_.pop_back();
  }
  waiting_changed_.notify_all();
  return {};
}

Status TriangleSpool::write(std::span<const Triangle> piece) try {
  for (const Triangle& t : piece) {
    RAYMILL_RETURN_IF_ERROR(writer_.add(t));
  }
  return {};
} catch (const std::bad_alloc&) {  // not out of the thread
  return {ErrorCode::budget_exceeded, "the machine has no memory left for this build; lower --memory or free some"};
}

void TriangleSpool::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    waiting_changed_.wait(lock, [this] { return !waiting_.empty() || ended_; });
    if (waiting_.empty()) {
      return;
    }
    Piece& piece = waiting_.front();  // stays where it is while others come behind it
    lock.unlock();
    Status status = write(piece);
    lock.lock();
    piece.clear();
    spare_.push_back(std::move(piece));
    waiting_.pop_front();
    waiting_changed_.notify_all();
    if (!status.ok()) {
      failure_ = std::move(status);
      return;
    }
  }
}

void TriangleSpool::stop() {
  if (!thread_.joinable()) {
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
  }
  waiting_changed_.notify_all();
  thread_.join();
}

Result<TriangleBucket> TriangleSpool::take() {
  stop();
  RAYMILL_RETURN_IF_ERROR(failure_);
  RAYMILL_RETURN_IF_ERROR(write(filling_));
  filling_ = Piece();
  spare_ = std::vector<Piece>();
  ended_ = false;
  return writer_.take();
}

}  // namespace raymill::storage
