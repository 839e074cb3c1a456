// Every limit of the protocol and of the server, and the transport's share of the memory budget.
//
// What grows with what, and the arithmetic, stand at each constant; the relations between them are asserted below.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "storage/base/ledger.h"
#include "traversal/query.h"

namespace raymill::server {

/// Raised when a peer of the version before could misread a message; the two ends must agree on it.
constexpr std::uint32_t kProtocolVersion = 1;

/// Rays of one chunk: a power of two between these, chosen for the budget. 64 Ki rays are a frame of 2 MiB: long
/// enough that the cost of a message (some ten microseconds) vanishes, short enough to stay in the caches.
constexpr std::uint32_t kLeastChunkRays = 4u << 10;
constexpr std::uint32_t kMostChunkRays = 64u << 10;
/// Longest hit row but for attributes: t 4, uv 8, three ids 12, normal 12. A message of rows is no longer than a chunk
/// of such rows, so longer ones are fewer to a message.
constexpr std::uint64_t kMostRowBytes = 36;

/// What a ray brings besides: a primitive 8, a mask 4. Chunks of such rays have half as many, and no more bytes; those
/// of rays of float64 have half as many again.
constexpr std::uint64_t kMostExtraBytes = 12;
static_assert((sizeof(Ray) + kMostExtraBytes) / 2 < sizeof(Ray));
static_assert(sizeof(Ray64) == 2 * sizeof(Ray) && (sizeof(Ray64) + kMostExtraBytes) / 4 < sizeof(Ray));
/// Masks of geometries that a job brings, 128 KiB: no part is longer than the shortest chunk.
constexpr std::uint32_t kMostGeometryMasks = 32u << 10;
/// Masks of all jobs that have not ended.
constexpr std::uint64_t kMostMaskBytes = kibibytes(256);
static_assert(kMostGeometryMasks * sizeof(std::uint32_t) <= kLeastChunkRays * sizeof(Ray));

/// Chunks of a job that may be on their way to the tracer, counted from the first that it has not taken yet.
constexpr std::uint64_t kChunkWindow = 4;
/// Row messages of a job that the client has not accepted yet.
constexpr std::uint64_t kRowsWindow = 4;

/// The Protocol Buffers part of a message from a client; the longest legal one is a name and a dozen numbers.
constexpr std::size_t kMostRequestBytes = 16u << 10;
/// The Protocol Buffers part of a message from a server: kMostKeptJobs jobs in a list, a kibibyte each at most.
constexpr std::size_t kMostReplyBytes = 4u << 20;
constexpr std::size_t kMostNameBytes = 1024;
constexpr std::size_t kMostSoftwareBytes = 128;
constexpr std::size_t kJobIdBytes = 16;
/// Metadata of a store (JSON) that a DescribeStore hands out.
constexpr std::size_t kMostMetadataBytes = 16u << 20;
constexpr std::size_t kMostListedStores = 2048;
/// Sentences in messages are cut here.
constexpr std::size_t kMostSentenceBytes = 512;

/// Jobs that wait for a place, and finished ones whose results are kept.
constexpr std::size_t kMostQueuedJobs = 256;
constexpr std::size_t kMostKeptJobs = 1024;
/// Chunks of one job: 2^40 rays at the least chunk.
constexpr std::uint64_t kMostChunksPerJob = std::uint64_t{1} << 28;

/// Frame of a FetchedRows.
constexpr std::uint64_t kFetchBytes = kibibytes(128);
/// Messages of one connection that ZeroMQ reads ahead: the window and the small ones between.
constexpr int kReceiveQueueMessages = static_cast<int>(kChunkWindow) + 4;
/// Messages that ZeroMQ keeps for one connection. A client that lets so many small ones pile up counts as gone.
constexpr int kSendQueueMessages = 512;

/// What two threads of a job (touched stack, allocator arena) and its messages hold beside the frames.
constexpr std::uint64_t kJobOverheadBytes = kibibytes(512);
/// What a connection holds in ZeroMQ (read buffer 8 KiB, write buffer 8 KiB, pipes) and here.
constexpr std::uint64_t kConnectionOverheadBytes = kibibytes(32);

static_assert(kMostReplyBytes >= (kMostKeptJobs + kMostQueuedJobs) * (kMostNameBytes + kMostSentenceBytes + 128));
static_assert(kMostReplyBytes >= kMostListedStores * (kMostNameBytes + 16));
static_assert(kMostRequestBytes > kMostNameBytes + 256);
static_assert(kMostMetadataBytes >= kMostChunkRays * kMostRowBytes, "a client's message limit covers rows");
static_assert(kSendQueueMessages > 8 * static_cast<int>(kRowsWindow + kChunkWindow));

/// How the server divides its memory: the transport's bound, and the chunk length that keeps it.
struct TransportPlan {
  std::uint32_t chunk_rays = kLeastChunkRays;
  std::uint64_t bytes = 0;  ///< the most that frames and messages hold at once
};

/// The most that the transport holds with chunks of `chunk_rays`:
///   jobs        x (kChunkWindow x chunk_rays x 32 B            chunks received and not yet taken by the tracer
///                + kRowsWindow x chunk_rays x 36 B             rows sent and not yet accepted by the client
///                + kJobOverheadBytes)
///   connections x (kFetchBytes + kConnectionOverheadBytes)     one fetch at a time each
///   + kMostMetadataBytes / 16                                  metadata is rare and short; a long one is copied once
///   + kMostMaskBytes
/// E.g. 1 job, 32 connections, 64 Ki: 17.0 + 0.5 + 5.0 + 1.0 + 0.25 = 23.75 MiB; with 4 Ki chunks: 7.8 MiB.
constexpr std::uint64_t transport_bytes(std::uint64_t jobs, std::uint64_t connections, std::uint64_t chunk_rays) {
  return jobs * (chunk_rays * (kChunkWindow * sizeof(Ray) + kRowsWindow * kMostRowBytes) + kJobOverheadBytes) +
         connections * (kFetchBytes + kConnectionOverheadBytes) + kMostMetadataBytes / 16 + kMostMaskBytes;
}
static_assert(transport_bytes(1, 32, kMostChunkRays) < mebibytes(24));
static_assert(transport_bytes(1, 32, kLeastChunkRays) < mebibytes(8));

/// The longest chunks for which the transport keeps to an eighth of `memory`; the shortest where none does.
constexpr TransportPlan plan_transport(std::uint64_t memory, std::uint64_t jobs, std::uint64_t connections) {
  std::uint32_t chunk_rays = kMostChunkRays;
  while (chunk_rays > kLeastChunkRays && transport_bytes(jobs, connections, chunk_rays) > memory / 8) {
    chunk_rays /= 2;
  }
  return {chunk_rays, transport_bytes(jobs, connections, chunk_rays)};
}
static_assert(plan_transport(mebibytes(64), 1, 32).chunk_rays == kLeastChunkRays);
static_assert(plan_transport(gibibytes(2), 1, 32).chunk_rays == kMostChunkRays);

}  // namespace raymill::server
