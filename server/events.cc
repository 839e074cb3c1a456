#include "server/events.h"

#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <memory>
#include <system_error>
#include <utility>

namespace raymill::server {

Result<std::unique_ptr<EventQueue>> EventQueue::create() {
  FileDescriptor wake(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  if (!wake.valid()) {
    return {ErrorCode::io, "no eventfd for the server's threads: " + std::generic_category().message(errno)};
  }
  return std::unique_ptr<EventQueue>(new EventQueue(std::move(wake)));
}

void EventQueue::post(Event event) {
  {
    const std::lock_guard lock(mutex_);
    events_.push_back(std::move(event));
  }
  wake();
}

std::vector<Event> EventQueue::take() {
  std::uint64_t count = 0;
  while (::read(wake_.get(), &count, sizeof count) < 0 && errno == EINTR) {
  }
  std::vector<Event> events;
  const std::lock_guard lock(mutex_);
  events.swap(events_);
  return events;
}

void EventQueue::wake() const {
  const int saved = errno;  // the caller may be a signal handler
  const std::uint64_t one = 1;
  // EAGAIN means that the counter is full: the reader is awake already.
  while (::write(wake_.get(), &one, sizeof one) < 0 && errno == EINTR) {
  }
  errno = saved;
}

}  // namespace raymill::server
