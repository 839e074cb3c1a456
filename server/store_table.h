// StoreTable: the stores that the server holds open, shared by jobs, `max_stores` at most.
//
//   reserve(name) -> users 1 -> open(name) ... release(name) -> users 0, idle -> closed after idle_seconds,
//                                                                          or at once when its slot is wanted
// A slot is taken before the store is opened, and closing comes before opening, so that the engine never needs more
// slots than there are. A store that could not be opened leaves its slot with its last user.
// Thread-safe; open() blocks, the others do not.
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "traversal/service.h"

namespace raymill::server {

using TimePoint = std::chrono::steady_clock::time_point;
using Clock = std::function<TimePoint()>;

struct StoreTableConfig {
  std::string stores_directory;
  std::size_t max_stores = 1;
  std::chrono::milliseconds idle{60'000};  ///< after its last job a store stays open for so long
};

class StoreTable {
 public:
  StoreTable(Service& service, StoreTableConfig config, Clock now);

  /// Takes a slot for one user of the store (canonical name); closes the store that has been idle longest where
  /// that makes room. False: every slot is in use.
  bool reserve(const std::string& name);
  /// Gives the user's place back.
  void release(const std::string& name);
  /// The store; opens it on first use. The caller has reserved it. Errors: those of store_path and Service::open.
  Result<std::shared_ptr<Store>> open(const std::string& name);
  /// Closes what has been idle for long enough; says when to look again.
  std::chrono::milliseconds close_idle();
  [[nodiscard]] std::size_t open_count() const;

 private:
  struct Entry {
    std::shared_ptr<Store> store;
    std::size_t users = 0;
    TimePoint idle_since;
  };

  void close_leaving();

  Service& service_;
  const StoreTableConfig config_;
  const Clock now_;
  mutable std::mutex mutex_;
  std::map<std::string, Entry> entries_;
  std::vector<std::shared_ptr<Store>> leaving_;  ///< out of the table, to be closed before the next opening
  std::mutex engine_mutex_;                      ///< one opening or closing at a time; taken before mutex_
};

}  // namespace raymill::server
