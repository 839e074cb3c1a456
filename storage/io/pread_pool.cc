#include "storage/io/pread_pool.h"

#include <utility>

namespace raymill::storage {

Result<std::unique_ptr<PreadPool>> PreadPool::create(std::shared_ptr<const StoreFile> file, unsigned depth,
                                                     Ledger& ledger, ReadDone done) {
  RAYMILL_ASSIGN_OR_RETURN(BudgetReservation reservation, ledger.claim(Tag::io, read_buffers_bytes(*file, depth)));
  std::unique_ptr<PreadPool> pool(new PreadPool(std::move(file), depth, std::move(done)));
  pool->reservation_ = std::move(reservation);
  for (unsigned i = 0; i < depth; ++i) {
    pool->threads_.emplace_back([raw = pool.get()] { raw->work(); });
  }
  return pool;
}

PreadPool::PreadPool(std::shared_ptr<const StoreFile> file, unsigned depth, ReadDone done)
    : file_(std::move(file)), depth_(depth), done_(std::move(done)), memory_(read_buffers_bytes(*file_, depth)) {
  for (unsigned i = 0; i < depth; ++i) {
    free_buffers_.push_back(i);
  }
}

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
    free_buffers_.push_back(arrival.buffer);
  }
  wake_.notify_one();
}

void PreadPool::work() {
  const std::uint64_t size = file_->read_buffer_bytes();
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return stopping_ || (!requests_.empty() && !free_buffers_.empty()); });
    if (stopping_) {
      return;
    }
    PageArrival arrival;
    arrival.page = requests_.front();
    requests_.erase(requests_.begin());
    arrival.buffer = free_buffers_.back();
    free_buffers_.pop_back();
    lock.unlock();
    auto encoded = file_->read_page(arrival.page, std::span(memory_).subspan(arrival.buffer * size, size));
    if (encoded) {
      arrival.encoded = *encoded;
    } else {
      arrival.status = encoded.status();
    }
    done_(arrival);
    lock.lock();
  }
}

}  // namespace raymill::storage
