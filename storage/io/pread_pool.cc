#include "storage/io/pread_pool.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace raymill::storage {

Result<std::unique_ptr<PreadPool>> PreadPool::create(std::shared_ptr<const StoreFile> file, unsigned depth,
                                                     Ledger& ledger, ReadDone done) {
  RAYMILL_ASSIGN_OR_RETURN(BudgetReservation reservation, ledger.claim(Tag::io, ReadBuffers::bytes(*file, depth)));
  std::unique_ptr<PreadPool> pool(new PreadPool(std::move(file), depth, std::move(done)));
  pool->reservation_ = std::move(reservation);
  for (unsigned i = 0; i < std::min(depth, kMostReaderThreads); ++i) {
    pool->threads_.emplace_back([raw = pool.get()] { raw->work(); });
  }
  return pool;
}

PreadPool::PreadPool(std::shared_ptr<const StoreFile> file, unsigned depth, ReadDone done)
    : file_(std::move(file)), depth_(depth), done_(std::move(done)), buffers_(*file_, depth) {}

PreadPool::~PreadPool() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) {
    thread.join();
  }
}

void PreadPool::start(PageId page) {
  {
    const std::lock_guard lock(mutex_);
    requests_.push_back(page);
  }
  wake_.notify_one();
}

void PreadPool::release(const PageArrival& arrival) {
  {
    const std::lock_guard lock(mutex_);
    buffers_.release(arrival.buffer);
  }
  wake_.notify_one();
}

void PreadPool::work() {
  std::unique_lock lock(mutex_);
  std::optional<PageRun> run;
  while (true) {
    wake_.wait(lock, [&] { return stopping_ || (run = buffers_.take(requests_)).has_value(); });
    if (stopping_) {
      return;
    }
    lock.unlock();
    reads_.fetch_add(1, std::memory_order_relaxed);
    const std::uint64_t bytes_read = file_->read_blocks(run->blocks, buffers_.bytes_of(*run));
    for (PageArrival& arrival : buffers_.arrivals(*run, bytes_read)) {
      done_(std::move(arrival));
    }
    lock.lock();
  }
}

}  // namespace raymill::storage
