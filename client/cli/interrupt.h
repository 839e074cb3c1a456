// SIGINT and SIGTERM: a handler sets a flag, the work looks at it, cancels its job and leaves no partial output. A
// second signal, two seconds later or more, ends the process at once. Thread-safe.
#pragma once

#include "storage/base/status.h"

namespace raymill::client {

/// Installs the handlers, and ignores SIGPIPE so that a closed pipe is an error of a write and not the end.
void install_signal_handlers();

/// The signal that came, 0 where none did.
int interrupt_signal();
inline bool interrupted() { return interrupt_signal() != 0; }
Status interrupted_status();

}  // namespace raymill::client
