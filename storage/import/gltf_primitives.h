// GltfPrimitives: one primitive of a mesh, placed by one node, becomes triangles.
//
//   POSITION --read by pieces--> float64 --node's matrix--> float32 --+
//   indices  --read by pieces--> checked ----------------------------+--> assembler --> filter --> sink
// Only an indexed primitive holds its vertices in memory (12 bytes each, claimed); indices and unindexed vertices flow
// through in pieces. Thread-confined.
#pragma once

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/import/gltf_buffers.h"
#include "storage/import/gltf_document.h"
#include "storage/import/primitive_readers.h"
#include "storage/import/scene_import.h"
#include "storage/import/transform.h"
#include "storage/import/triangle_filter.h"

namespace tinygltf {
struct Primitive;
}  // namespace tinygltf

namespace raymill::storage {

class GltfAttributes;
class GltfMasks;

/// What all primitives of an import share.
struct PrimitiveContext {
  const GltfDocument& document;
  GltfBuffers& buffers;
  Ledger& ledger;
  TriangleWriter& out;
  ImportReport& report;
  GltfMasks* masks = nullptr;            ///< none: everything is opaque and has two sides
  GltfAttributes* attributes = nullptr;  ///< none: none are asked for
};

/// Scratch of one primitive beside its own claims: a piece of raw and of placed corners, of raw and of read indices.
constexpr std::uint64_t kPrimitiveScratchBytes = kPieceCorners * (2 * sizeof(Vec3f) + 2 * sizeof(std::uint32_t));

/// Hands the triangles of `primitive` on and counts what is met. Points, lines and primitives without positions give
/// none. Errors: bad_scene, unsupported, not_found, io, budget_exceeded, and the sink's.
Status import_primitive(const tinygltf::Primitive& primitive, const Transform& world_from_node,
                        const PrimitiveContext& context);

}  // namespace raymill::storage
