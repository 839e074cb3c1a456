#include "server/store_table.h"

#include <algorithm>
#include <cassert>
#include <utility>

#include "server/store_names.h"

namespace raymill::server {

StoreTable::StoreTable(Service& service, StoreTableConfig config, Clock now)
    : service_(service), config_(std::move(config)), now_(std::move(now)) {}

bool StoreTable::reserve(const std::string& name) {
  const std::lock_guard lock(mutex_);
  if (const auto found = entries_.find(name); found != entries_.end()) {
    ++found->second.users;
    return true;
  }
  if (entries_.size() >= config_.max_stores) {
    auto longest = entries_.end();
    for (auto it = entries_.begin(); it != entries_.end(); ++it) {
      if (it->second.users == 0 && (longest == entries_.end() || it->second.idle_since < longest->second.idle_since)) {
        longest = it;
      }
    }
    if (longest == entries_.end()) {
      return false;
    }
    leaving_.push_back(std::move(longest->second.store));
    entries_.erase(longest);
  }
  entries_[name].users = 1;
  return true;
}

void StoreTable::release(const std::string& name) {
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(name);
  assert(found != entries_.end() && found->second.users > 0);
  Entry& entry = found->second;
  if (--entry.users == 0) {
    entry.idle_since = now_();
    if (!entry.store) {
      entries_.erase(found);
    }
  }
}

Result<std::shared_ptr<Store>> StoreTable::open(const std::string& name) {
  const std::lock_guard engine(engine_mutex_);
  {
    const std::lock_guard lock(mutex_);
    if (const auto& store = entries_.at(name).store) {
      return store;
    }
  }
  close_leaving();
  RAYMILL_ASSIGN_OR_RETURN(const std::string path, store_path(config_.stores_directory, name));
  RAYMILL_ASSIGN_OR_RETURN(std::shared_ptr<Store> store, service_.open(path));
  const std::lock_guard lock(mutex_);
  entries_.at(name).store = store;
  return store;
}

void StoreTable::close_leaving() {
  std::vector<std::shared_ptr<Store>> closing;
  const std::lock_guard lock(mutex_);
  closing.swap(leaving_);
}

std::chrono::milliseconds StoreTable::close_idle() {
  auto next = config_.idle;
  {
    const std::lock_guard lock(mutex_);
    const TimePoint now = now_();
    for (auto it = entries_.begin(); it != entries_.end();) {
      const auto idle = std::chrono::duration_cast<std::chrono::milliseconds>(now - it->second.idle_since);
      if (it->second.users > 0) {
        ++it;
      } else if (idle >= config_.idle) {
        leaving_.push_back(std::move(it->second.store));
        it = entries_.erase(it);
      } else {
        next = std::min(next, config_.idle - idle);
        ++it;
      }
    }
  }
  // An opening that is under way keeps this for later rather than make its caller wait.
  if (const std::unique_lock engine(engine_mutex_, std::try_to_lock); engine.owns_lock()) {
    close_leaving();
    return next;
  }
  return std::min(next, std::chrono::milliseconds(100));
}

std::size_t StoreTable::open_count() const {
  const std::lock_guard lock(mutex_);
  return static_cast<std::size_t>(
      std::count_if(entries_.begin(), entries_.end(), [](const auto& entry) { return entry.second.store != nullptr; }));
}

}  // namespace raymill::server
