#include "client/cli/interrupt.h"

#include <unistd.h>

#include <csignal>
#include <cstdint>
#include <ctime>

namespace raymill::client {

namespace {

// Some senders signal a process and its group, so one stop arrives twice; a person who signals again means it.
constexpr std::int64_t kGraceSeconds = 2;
constexpr int kExitBase = 128;

volatile std::sig_atomic_t signal_number = 0;
volatile std::int64_t signal_seconds = 0;

// clock_gettime() and _exit() may be called here (POSIX, async-signal-safe).
void remember(int number) {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  if (signal_number == 0) {
    signal_number = number;
    signal_seconds = now.tv_sec;
  } else if (now.tv_sec - signal_seconds >= kGraceSeconds) {
    _exit(kExitBase + number);
  }
}

}  // namespace

void install_signal_handlers() {
  struct sigaction action {};
  action.sa_handler = remember;
  sigemptyset(&action.sa_mask);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
}

int interrupt_signal() { return signal_number; }

Status interrupted_status() {
  return {ErrorCode::interrupted, signal_number == SIGTERM ? "stopped by SIGTERM" : "stopped by SIGINT"};
}

}  // namespace raymill::client
