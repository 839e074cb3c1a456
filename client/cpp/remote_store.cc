#include "client/cpp/remote_store.h"

#include <string_view>
#include <utility>

#include "client/cpp/job_link.h"

namespace raymill::client {

namespace {

/// The Job interface over a JobLink.
class RemoteJob final : public Job {
 public:
  explicit RemoteJob(std::unique_ptr<JobLink> link) : link_(std::move(link)) {}
  Status push(std::span<const Ray> rays) override { return link_->push(rays); }
  Status push_with(std::span<const Ray> rays, const RayExtras& extras) override { return link_->push(rays, extras); }
  Status push64(std::span<const Ray64> rays, const RayExtras& extras) override { return link_->push64(rays, extras); }
  Status finish() override { return link_->finish(); }
  std::optional<HitChunk> next() override { return link_->next(); }
  [[nodiscard]] Status status() const override { return link_->status(); }
  [[nodiscard]] JobProgress progress() const override { return link_->progress(); }
  [[nodiscard]] JobStats stats() const override { return link_->stats(); }
  void cancel() override { link_->cancel(); }

 private:
  const std::unique_ptr<JobLink> link_;
};

}  // namespace

Result<StoreInfo> RemoteStore::info() const {
  pb::ClientMessage message;
  message.mutable_describe_store()->set_name(name_);
  RAYMILL_ASSIGN_OR_RETURN(const ServerPacket answer,
                           session_->ask_disk(std::move(message), pb::ServerMessage::kStoreDescription));
  const auto metadata = answer.frame->to_string_view();
  return server::from_wire(answer.message.store_description(), metadata);
}

Result<std::unique_ptr<Job>> RemoteStore::trace(const TraceConfig& config) {
  RAYMILL_ASSIGN_OR_RETURN(std::unique_ptr<JobLink> link,
                           JobLink::start(session_->context, session_->config, {.store = name_, .trace = config}));
  return std::unique_ptr<Job>(std::make_unique<RemoteJob>(std::move(link)));
}

}  // namespace raymill::client
