#include "client/cpp/client.h"

#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>

#include "client/cpp/client_impl.h"
#include "client/cpp/remote_store.h"
#include "server/limits.h"

namespace raymill {

namespace pb = client::pb;

std::string_view to_string(JobState state) {
  switch (state) {
    case JobState::queued:
      return "queued";
    case JobState::running:
      return "running";
    case JobState::done:
      return "done";
    case JobState::failed:
      return "failed";
    case JobState::cancelled:
      return "cancelled";
  }
  return "unknown";
}

Client::Client(std::shared_ptr<Impl> impl) : impl_(std::move(impl)) {}
Client::~Client() = default;

Result<std::unique_ptr<Client>> Client::connect(const ClientConfig& config) {
  auto session = std::make_shared<client::Session>();
  try {
    session->context = std::make_shared<zmq::context_t>(1);
  } catch (const zmq::error_t& error) {
    return {ErrorCode::io, std::string("no ZeroMQ for a client: ") + error.what()};
  }
  session->config = config;
  RAYMILL_ASSIGN_OR_RETURN(session->connection, client::Connection::open(session->context, config, {}));
  return std::unique_ptr<Client>(new Client(std::make_shared<Impl>(Impl{std::move(session)})));
}

Result<std::shared_ptr<Store>> Client::open(const std::string& name) {
  pb::ClientMessage message;
  message.mutable_open_store()->set_name(name);
  RAYMILL_RETURN_IF_ERROR(impl_->session->ask_disk(std::move(message), pb::ServerMessage::kStoreOpened).status());
  return std::shared_ptr<Store>(std::make_shared<client::RemoteStore>(impl_->session, name));
}

Result<std::vector<std::string>> Client::stores() {
  pb::ClientMessage message;
  message.mutable_list_stores();
  RAYMILL_ASSIGN_OR_RETURN(const client::ServerPacket answer,
                           impl_->session->ask_disk(std::move(message), pb::ServerMessage::kStoreList));
  const auto& names = answer.message.store_list().names();
  return std::vector<std::string>(names.begin(), names.end());
}

}  // namespace raymill
