// RemoteStore: a store on a server, with the calls of the embedded one. Thread-safe.
#pragma once

#include <memory>
#include <string>

#include "client/cpp/session.h"
#include "traversal/service.h"

namespace raymill::client {

class RemoteStore final : public Store {
 public:
  RemoteStore(std::shared_ptr<Session> session, std::string name)
      : session_(std::move(session)), name_(std::move(name)) {}

  /// Errors: those of Store::info, and unavailable, busy_retry (every slot of the server is at work).
  [[nodiscard]] Result<StoreInfo> info() const override;
  Result<std::unique_ptr<Job>> trace(const TraceConfig& config) override;

 private:
  const std::shared_ptr<Session> session_;
  const std::string name_;
};

}  // namespace raymill::client
