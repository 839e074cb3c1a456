#include "storage/io/uring_reader.h"

#include <liburing.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <optional>
#include <utility>

namespace raymill::storage {
namespace {

// What a ring is beside the buffers. Two mapped areas of at most a page and a table each, and for a read an entry of 64
// bytes, two completions of 16, the kernel's own request and a slot.
constexpr std::uint64_t kRingBytes = 16 << 10;
constexpr std::uint64_t kReadBytes = 512;

// The completion of the eventfd's poll; other completions carry the number of their buffer.
constexpr std::uint64_t kWakeTag = ~std::uint64_t{0};

// The kernel is out of memory for requests or wants completions to be taken first.
constexpr auto kBusyPause = std::chrono::milliseconds(1);

Status refused(int error) {
  return {ErrorCode::unsupported, std::string("io_uring is refused here (") + std::strerror(error) +
                                      "), as containers often do; read pages by --io auto or pread"};
}

}  // namespace

// The kernel's ring with what is registered at it. Thread-confined.
class UringReader::Ring {
 public:
  Ring() = default;
  Ring(const Ring&) = delete;
  Ring& operator=(const Ring&) = delete;
  ~Ring() {
    if (open_) {
      io_uring_queue_exit(&ring_);
    }
    if (event_ >= 0) {
      ::close(event_);
    }
  }

  Status init(unsigned depth) {
    // A read for each buffer, and the eventfd's poll.
    if (const int error = io_uring_queue_init(depth + 1, &ring_, 0); error < 0) {
      return refused(-error);
    }
    open_ = true;
    io_uring_probe* probe = io_uring_get_probe_ring(&ring_);
    const bool reads = probe != nullptr && io_uring_opcode_supported(probe, IORING_OP_READ) != 0;
    io_uring_free_probe(probe);
    if (!reads) {
      return refused(EOPNOTSUPP);
    }
    event_ = ::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    return event_ >= 0 ? Status() : refused(errno);
  }

  // Saves the kernel a look-up of the file and of the pages for each read. Both may be refused (RLIMIT_MEMLOCK): reads
  // work without.
  void register_file(int descriptor, std::span<std::byte> memory) {
    descriptor_ = descriptor;
    fixed_file_ = io_uring_register_files(&ring_, &descriptor, 1) == 0;
    const iovec area{memory.data(), memory.size()};
    fixed_memory_ = io_uring_register_buffers(&ring_, &area, 1) == 0;
  }

  void watch_event() {
    io_uring_sqe* entry = io_uring_get_sqe(&ring_);
    io_uring_prep_poll_add(entry, event_, POLLIN);
    io_uring_sqe_set_data64(entry, kWakeTag);
  }
  void signal_event() const {
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t ignored = ::write(event_, &one, sizeof one);  // a full counter is signalled already
  }
  void clear_event() const {
    std::uint64_t count = 0;
    [[maybe_unused]] const ssize_t ignored = ::read(event_, &count, sizeof count);
  }

  void read(std::span<std::byte> into, std::uint64_t offset, unsigned buffer) {
    io_uring_sqe* entry = io_uring_get_sqe(&ring_);  // never full: an entry for each buffer and the poll
    const int file = fixed_file_ ? 0 : descriptor_;
    const auto bytes = static_cast<unsigned>(into.size());
    if (fixed_memory_) {
      io_uring_prep_read_fixed(entry, file, into.data(), bytes, offset, 0);
    } else {
      io_uring_prep_read(entry, file, into.data(), bytes, offset);
    }
    if (fixed_file_) {
      entry->flags |= IOSQE_FIXED_FILE;
    }
    io_uring_sqe_set_data64(entry, buffer);
  }

  // Submits what was prepared and waits for a completion.
  void submit_and_wait() {
    const int result = io_uring_submit_and_wait(&ring_, 1);
    if (result < 0 && result != -EINTR) {
      std::this_thread::sleep_for(kBusyPause);  // what was not submitted is, the next time
    }
  }

  struct Completion {
    std::uint64_t tag = 0;
    int result = 0;
  };
  std::optional<Completion> take_completion() {
    io_uring_cqe* entry = nullptr;
    if (io_uring_peek_cqe(&ring_, &entry) != 0) {
      return std::nullopt;
    }
    const Completion completion{entry->user_data, entry->res};
    io_uring_cqe_seen(&ring_, entry);
    return completion;
  }

 private:
  io_uring ring_{};
  bool open_ = false;
  int event_ = -1;
  int descriptor_ = -1;
  bool fixed_file_ = false;
  bool fixed_memory_ = false;
};

Status UringReader::available() { return Ring().init(1); }

std::uint64_t UringReader::bytes(const StoreFile& file, unsigned depth) {
  return ReadBuffers::bytes(file, depth) + kRingBytes + depth * kReadBytes;
}

Result<std::unique_ptr<UringReader>> UringReader::create(std::shared_ptr<const StoreFile> file, unsigned depth,
                                                         Ledger& ledger, ReadDone done) {
  RAYMILL_ASSIGN_OR_RETURN(BudgetReservation reservation, ledger.claim(Tag::io, bytes(*file, depth)));
  auto ring = std::make_unique<Ring>();
  RAYMILL_RETURN_IF_ERROR(ring->init(depth));
  std::unique_ptr<UringReader> reader(new UringReader(std::move(file), depth, std::move(done)));
  reader->reservation_ = std::move(reservation);
  ring->register_file(reader->file_->read_descriptor(), reader->buffers_.memory());
  reader->ring_ = std::move(ring);
  reader->thread_ = std::thread([raw = reader.get()] { raw->work(); });
  return reader;
}

UringReader::UringReader(std::shared_ptr<const StoreFile> file, unsigned depth, ReadDone done)
    : file_(std::move(file)), depth_(depth), done_(std::move(done)), buffers_(*file_, depth) {}

UringReader::~UringReader() {
  if (!thread_.joinable()) {
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    wake();
  }
  thread_.join();  // after the last read: the kernel writes into the buffers until then
}

void UringReader::start(PageId page) {
  const std::lock_guard lock(mutex_);
  requests_.push_back(page);
  wake();
}

void UringReader::release(const PageArrival& arrival) {
  const std::lock_guard lock(mutex_);
  buffers_.release(arrival.buffer);
  if (!requests_.empty()) {
    wake();
  }
}

// Called with the mutex. One signal for all that comes until the ring's thread looks.
void UringReader::wake() {
  if (!woken_) {
    woken_ = true;
    ring_->signal_event();
  }
}

void UringReader::work() {
  ring_->watch_event();
  while (take_requests()) {
    ring_->submit_and_wait();
    while (const auto completion = ring_->take_completion()) {
      if (completion->tag == kWakeTag) {
        ring_->clear_event();
        ring_->watch_event();
      } else {
        complete(buffers_.run_in(static_cast<unsigned>(completion->tag)), completion->result);
      }
    }
  }
}

bool UringReader::take_requests() {
  const std::lock_guard lock(mutex_);
  woken_ = false;
  if (stopping_) {
    return in_flight_ > 0;
  }
  while (const auto run = buffers_.take(requests_)) {
    ring_->read(buffers_.bytes_of(*run), run->blocks.offset, run->buffer);
    ++in_flight_;
    reads_.fetch_add(1, std::memory_order_relaxed);
  }
  return true;
}

// `result`: bytes read, or an error number below zero.
void UringReader::complete(const PageRun& run, int result) {
  std::vector<PageArrival> arrivals = buffers_.arrivals(run, static_cast<std::uint64_t>(std::max(result, 0)));
  if (!file_->direct()) {
    file_->forget(run.blocks);
  }
  --in_flight_;
  for (PageArrival& arrival : arrivals) {
    done_(std::move(arrival));
  }
}

}  // namespace raymill::storage
