// Desk: the thread that answers the requests which touch the disk, so that the router thread never waits for one.
//
// One request of a connection at a time: the queue is bounded by the number of connections. Metadata is the one long
// answer; only one is on its way at a time. Public calls are thread-safe.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <variant>

#include "server/events.h"
#include "server/spool.h"
#include "server/store_table.h"

namespace raymill::server {

struct OpenTask {
  std::string store;      ///< canonical name
  bool describe = false;  ///< answer with a StoreDescription
};
struct ListTask {};
struct FetchTask {
  std::string job;
  Field fields = Field::none;
  std::uint64_t first_row = 0;
  std::uint64_t total_rows = 0;
};

struct DeskTask {
  std::string connection;
  std::uint64_t sequence = 0;
  std::variant<OpenTask, ListTask, FetchTask> what;
};

class Desk {
 public:
  Desk(std::string stores_directory, StoreTable& stores, const Spool& spool, EventQueue& events);
  ~Desk();
  void put(DeskTask task);

 private:
  void run();
  DeskEvent answer(const OpenTask& task);
  DeskEvent answer(const ListTask& task);
  DeskEvent answer(const FetchTask& task);
  DeskEvent describe(const Store& store);

  const std::string stores_directory_;
  StoreTable& stores_;
  const Spool& spool_;
  EventQueue& events_;
  /// True while a metadata frame is somewhere between here and the wire; frames may outlive the desk.
  const std::shared_ptr<std::atomic<bool>> metadata_out_ = std::make_shared<std::atomic<bool>>(false);

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<DeskTask> tasks_;
  bool stopping_ = false;
  std::thread thread_;
};

/// The answer that carries a Status which is not ok.
void set_error(pb::ServerMessage& message, const Status& status, const std::string& job = {});

}  // namespace raymill::server
