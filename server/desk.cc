#include "server/desk.h"

#include <algorithm>
#include <span>
#include <utility>

#include "server/limits.h"
#include "server/store_names.h"
#include "storage/base/checksum.h"

namespace raymill::server {

namespace {

/// Metadata on its way: the string, and the flag that says so.
struct MetadataOut {
  std::string text;
  std::shared_ptr<std::atomic<bool>> out;
};

void free_metadata(void*, void* hint) {
  const std::unique_ptr<MetadataOut> held(static_cast<MetadataOut*>(hint));
  held->out->store(false, std::memory_order_release);
}

DeskEvent error_event(const Status& status, const std::string& job = {}) {
  DeskEvent event;
  set_error(event.reply, status, job);
  return event;
}

}  // namespace

void set_error(pb::ServerMessage& message, const Status& status, const std::string& job) {
  pb::Error& error = *message.mutable_error();
  error.set_code(static_cast<std::uint32_t>(status.code()));
  error.set_message(cut_sentence(status.message()));
  error.set_job(job);
}

Desk::Desk(std::string stores_directory, StoreTable& stores, const Spool& spool, EventQueue& events)
    : stores_directory_(std::move(stores_directory)), stores_(stores), spool_(spool), events_(events) {
  thread_ = std::thread([this] { run(); });
}

Desk::~Desk() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void Desk::put(DeskTask task) {
  {
    const std::lock_guard lock(mutex_);
    tasks_.push_back(std::move(task));
  }
  changed_.notify_all();
}

void Desk::run() {
  while (true) {
    DeskTask task;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return stopping_ || !tasks_.empty(); });
      if (stopping_) {
        return;
      }
      task = std::move(tasks_.front());
      tasks_.pop_front();
    }
    DeskEvent event = std::visit([this](const auto& what) { return answer(what); }, task.what);
    event.connection = std::move(task.connection);
    event.reply.set_sequence(task.sequence);
    events_.post(std::move(event));
  }
}

DeskEvent Desk::answer(const OpenTask& task) {
  if (!stores_.reserve(task.store)) {
    // Every slot is at work. That the file is there can be said; whether it is sound, its job will say.
    const auto path = store_path(stores_directory_, task.store);
    if (!path.ok()) {
      return error_event(path.status());
    }
    if (task.describe) {
      return error_event(
          {ErrorCode::busy_retry, "every store that this server may hold open is at work; try again later"});
    }
    DeskEvent event;
    event.reply.mutable_store_opened();
    return event;
  }
  DeskEvent event;
  const auto store = stores_.open(task.store);
  if (!store.ok()) {
    event = error_event(store.status());
  } else if (task.describe) {
    event = describe(**store);
    if (event.reply.has_store_description()) {
      event.reply.mutable_store_description()->set_name(utf8_or_question_marks(task.store));
    }
  } else {
    event.reply.mutable_store_opened();
  }
  stores_.release(task.store);
  return event;
}

DeskEvent Desk::describe(const Store& store) {
  if (metadata_out_->exchange(true, std::memory_order_acquire)) {
    return error_event({ErrorCode::busy_retry, "another client is reading a store's metadata; try again"});
  }
  auto info = store.info();
  if (!info.ok() || info->metadata_json.size() > kMostMetadataBytes) {
    metadata_out_->store(false);
    return error_event(info.ok() ? Status(ErrorCode::unsupported,
                                          "the store's metadata has " + std::to_string(info->metadata_json.size()) +
                                              " bytes, more than a message holds; run raymill info beside the store")
                                 : info.status());
  }
  DeskEvent event;
  *event.reply.mutable_store_description() = to_wire(*info);
  auto out = std::make_unique<MetadataOut>(MetadataOut{std::move(info->metadata_json), metadata_out_});
  std::string& text = out->text;
  event.frame.emplace(text.data(), text.size(), free_metadata, out.get());
  (void)out.release();  // the frame's now
  return event;
}

DeskEvent Desk::answer(const ListTask&) {
  const StoreNames found = list_stores(stores_directory_);
  DeskEvent event;
  pb::StoreList& list = *event.reply.mutable_store_list();
  for (const std::string& name : found.names) {
    list.add_names(utf8_or_question_marks(name));
  }
  list.set_truncated(found.truncated);
  return event;
}

DeskEvent Desk::answer(const FetchTask& task) {
  const std::uint64_t row_bytes = HitLayout(task.fields).row_bytes();
  const std::uint64_t rows = std::min(kFetchBytes / row_bytes, task.total_rows - task.first_row);
  DeskEvent event;
  event.frame.emplace(rows * row_bytes);
  const auto status = spool_.read(task.job, task.first_row * row_bytes, bytes_of(*event.frame));
  if (!status.ok()) {
    return error_event(status, task.job);
  }
  pb::FetchedRows& fetched = *event.reply.mutable_fetched_rows();
  fetched.set_job(task.job);
  fetched.set_first_row(task.first_row);
  fetched.set_rows(rows);
  fetched.set_total_rows(task.total_rows);
  fetched.set_fields(static_cast<std::uint32_t>(task.fields));
  fetched.set_checksum(storage::checksum(bytes_of(*event.frame)));
  return event;
}

}  // namespace raymill::server
