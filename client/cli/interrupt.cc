#include "client/cli/interrupt.h"

#include <csignal>

namespace raymill::client {

namespace {

volatile std::sig_atomic_t signal_number = 0;

void remember(int number) { signal_number = number; }

}  // namespace

void install_signal_handlers() {
  struct sigaction action {};
  action.sa_handler = remember;
  action.sa_flags = static_cast<int>(SA_RESETHAND);
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
