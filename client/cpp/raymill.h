// Everything public: the embedded Engine, the remote Client, and building, verifying and inspecting stores.
#pragma once

#include "client/cpp/client.h"
#include "storage/io/build_store.h"
#include "storage/io/store_costs.h"
#include "traversal/engine.h"
#include "traversal/service.h"
