// What the sanitizers are told about ZeroMQ, in every test program that opens sockets. Without a sanitizer nobody calls
// this.
//
// The packaged libzmq is not built with the thread sanitizer: it hands messages between its threads and ours through
// its own lock-free pipes and mailboxes, whose atomics the sanitizer does not see. So what it does inside (its reads,
// writes and allocations) is ignored. Our own threads share nothing through ZeroMQ but whole messages, so that no race
// of ours is hidden: those between our threads go through mutexes that are seen.
extern "C" const char* __tsan_default_suppressions();
extern "C" const char* __tsan_default_suppressions() {
  return "called_from_lib:libzmq.so.5\n"
         "race:libzmq.so.5\n";
}

// libzmq 4.3.4 loses the first part of a message whose second part is still on its way when the socket is closed: in
// pipe_t, the delimiter that comes before the command to end (state delimiter_received) ends the pipe without the
// rollback that every other way has. One part for each socket that is closed under load, seen in one of a hundred runs
// of ServerGone.AJobEndsWhenTheServerShutsDown with every core busy. Our messages free themselves (zmq::message_t).
extern "C" const char* __lsan_default_suppressions();
extern "C" const char* __lsan_default_suppressions() { return "leak:libzmq.so.5\n"; }
