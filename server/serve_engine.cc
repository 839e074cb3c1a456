// Server::start with the real engine: apart, so that a test of the server alone links no tracer.
#include "server/server.h"
#include "traversal/engine.h"

namespace raymill::server {

Result<std::unique_ptr<Server>> Server::start(const ServeConfig& config) {
  ServerParts parts;
  parts.make_service = [](const EngineConfig& engine_config) -> Result<std::unique_ptr<Service>> {
    RAYMILL_ASSIGN_OR_RETURN(std::unique_ptr<Engine> engine, Engine::create(engine_config));
    return std::unique_ptr<Service>(std::move(engine));
  };
  return start(config, std::move(parts));
}

}  // namespace raymill::server
