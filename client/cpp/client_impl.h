// What a Client holds; shared by the files that implement it.
#pragma once

#include <memory>

#include "client/cpp/client.h"
#include "client/cpp/session.h"

namespace raymill {

class Client::Impl {
 public:
  std::shared_ptr<client::Session> session;
};

}  // namespace raymill
