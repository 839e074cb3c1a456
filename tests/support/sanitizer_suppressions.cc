// What the sanitizers are told about libraries that are packaged without them, in every test program of the presets
// `asan` and `tsan`.
//
// ZeroMQ hands messages between its threads and ours through lock-free pipes and mailboxes of its own, whose atomics
// the thread sanitizer does not see. So what it does inside (its reads, writes and allocations) is ignored. Our own
// threads share nothing through ZeroMQ but whole messages, so that no race of ours is hidden: those between our threads
// go through mutexes that are seen.
//
// oneTBB hands work between its threads alike, and what its pipelines and sorts call is ours: every hand-over from one
// filter to the next looks like a race, and so does what the caller does with it afterwards. So what is called by it is
// ignored too, and the builder, which waits for it. That hides races in builds; tests that compare their bytes
// for one and many threads are what watches them.
extern "C" const char* __tsan_default_suppressions();
extern "C" const char* __tsan_default_suppressions() {
  return "called_from_lib:libzmq.so.5\n"
         "race:libzmq.so.5\n"
         "race:libtbb.so.12\n"
         "race:tbb::detail\n"
         "race:raymill::storage::StoreBuilder::\n";
}

// libzmq 4.3.4 loses the first part of a message whose second part is still on its way when the socket is closed: in
// pipe_t, the delimiter that comes before the command to end (state delimiter_received) ends the pipe without the
// rollback that every other way has. One part for each socket that is closed under load, seen in one of a hundred runs
// of ServerGone.AJobEndsWhenTheServerShutsDown with every core busy. Our messages free themselves (zmq::message_t).
extern "C" const char* __lsan_default_suppressions();
extern "C" const char* __lsan_default_suppressions() { return "leak:libzmq.so.5\n"; }
