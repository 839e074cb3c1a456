// What ThreadSanitizer is told about ZeroMQ, in every test program that opens sockets. Without the sanitizer nobody
// calls this.
//
// The packaged libzmq is not built with the sanitizer: it hands messages between its threads and ours through its own
// lock-free pipes and mailboxes, whose atomics the sanitizer does not see. So what it does inside (its reads, writes
// and allocations) is ignored. Our own threads share nothing through ZeroMQ but whole messages, so that no race of
// ours is hidden: those between our threads go through mutexes that are seen.
extern "C" const char* __tsan_default_suppressions();
extern "C" const char* __tsan_default_suppressions() {
  return "called_from_lib:libzmq.so.5\n"
         "race:libzmq.so.5\n";
}
