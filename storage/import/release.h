// release(): gives a container's heap back. Stateless.
#pragma once

namespace raymill::storage {

/// Assigning {} keeps the capacity of strings and vectors, and so the memory that a claim has just let go.
template <typename Container>
void release(Container& container) {
  Container().swap(container);
}

}  // namespace raymill::storage
