#include "traversal/waiting_rays.h"

#include <algorithm>
#include <cassert>
#include <cstring>
#include <utility>

#include "storage/base/checksum.h"

namespace raymill::traversal {

std::uint64_t WaitingRays::table_bytes(const Config& config) {
  const std::uint64_t groups = (config.page_count + config.group_pages - 1) / config.group_pages;
  // A group's list of extents may be twice as large as what it holds.
  return config.page_count * sizeof(RayQueue) + groups * sizeof(Group) +
         std::uint64_t(config.most_extents) * 2 * sizeof(Extent) + SpillFile::table_bytes(config.most_extents);
}

std::uint64_t WaitingRays::transfer_bytes(std::size_t extent_bytes) {
  return extent_bytes + most_parts(extent_bytes) * 2 * sizeof(Part);
}

Result<std::unique_ptr<WaitingRays>> WaitingRays::create(const Config& config, storage::Ledger& ledger) {
  RAYMILL_ASSIGN_OR_RETURN(storage::BudgetReservation claim, ledger.claim(storage::Tag::rays, table_bytes(config)));
  RAYMILL_ASSIGN_OR_RETURN(std::unique_ptr<RayPool> pool, RayPool::create(config.layout, config.pool_chunks, ledger));
  return std::unique_ptr<WaitingRays>(new WaitingRays(config, std::move(pool), std::move(claim)));
}

WaitingRays::WaitingRays(const Config& config, std::unique_ptr<RayPool> pool, storage::BudgetReservation claim)
    : config_(config),
      claim_(std::move(claim)),
      pool_(std::move(pool)),
      queues_(config.page_count),
      groups_((config.page_count + config.group_pages - 1) / config.group_pages),
      file_({config.directory, "waiting rays", config.extent_bytes, config.most_extents, true}) {}

std::byte* WaitingRays::append(storage::PageId page, std::size_t record_bytes) {
  std::byte* record = pool_->append(queues_[index_of(page)], record_bytes);
  groups_[group_of(page)].memory_rays += record != nullptr ? 1 : 0;
  return record;
}

RayQueue WaitingRays::take(storage::PageId page, std::uint32_t rays) {
  const RayQueue taken = pool_->take(queues_[index_of(page)], rays);
  groups_[group_of(page)].memory_rays -= taken.count;
  return taken;
}

WaitingRays::Parcel WaitingRays::begin_parcel(std::uint32_t group) {
  Parcel parcel;
  parcel.group = group;
  parcel.place = file_.take();
  parcel.parts.reserve(64);
  return parcel;
}

// An extent is full when it might not take another chunk.
bool WaitingRays::full(const Parcel& parcel) const {
  return parcel.bytes + sizeof(PartHeader) + kRayChunkBytes > config_.extent_bytes ||
         parcel.parts.size() == most_parts(config_.extent_bytes);
}

void WaitingRays::add_part(Parcel& parcel, storage::PageId page) {
  const std::size_t room = config_.extent_bytes - parcel.bytes - sizeof(PartHeader);
  std::size_t bytes = 0;
  const RayQueue rays = pool_->take_bytes(queues_[index_of(page)], room, bytes);
  groups_[parcel.group].memory_rays -= rays.count;
  parcel.rays += rays.count;
  parcel.bytes += sizeof(PartHeader) + bytes;
  parcel.parts.push_back({page, static_cast<std::uint32_t>(bytes), rays});
}

Status WaitingRays::store(Parcel& parcel, std::span<std::byte> buffer) {
  std::byte* at = buffer.data();
  for (const Part& part : parcel.parts) {
    const PartHeader header{index_of(part.page), part.rays.count, part.bytes};
    std::memcpy(at, &header, sizeof header);
    at += sizeof header;
    pool_->for_each_chunk(part.rays, [&](std::span<const std::byte> records) {
      std::memcpy(at, records.data(), records.size());
      at += records.size();
    });
  }
  assert(static_cast<std::size_t>(at - buffer.data()) == parcel.bytes);
  const auto bytes = buffer.first(parcel.bytes);
  parcel.checksum = storage::checksum(bytes);
  return file_.write(parcel.place, bytes);
}

void WaitingRays::retire(Parcel& parcel) {
  for (Part& part : parcel.parts) {
    pool_->release(part.rays);
  }
  Group& group = groups_[parcel.group];
  group.extents.push_back({parcel.place, static_cast<std::uint32_t>(parcel.bytes), parcel.rays,
                           static_cast<std::uint32_t>(parcel.parts.size()), parcel.checksum, next_extent_++});
  ++extent_count_;
  group.disk_rays += parcel.rays;
  rays_on_disk_ += parcel.rays;
  spilled_bytes_ += parcel.bytes;
}

std::uint32_t WaitingRays::chunks_for(const Extent& extent) const {
  return static_cast<std::uint32_t>(RayPool::chunks_for(extent.bytes, extent.parts, config_.layout.most_bytes()));
}

WaitingRays::Extent WaitingRays::begin_fetch(std::uint32_t group) {
  Group& g = groups_[group];
  const Extent extent = g.extents.front();
  g.extents.erase(g.extents.begin());
  if (g.extents.empty()) {
    g.extents.shrink_to_fit();
  }
  --extent_count_;
  g.disk_rays -= extent.rays;
  rays_on_disk_ -= extent.rays;
  fetched_bytes_ += extent.bytes;
  return extent;
}

Status WaitingRays::fetch(const Extent& extent, std::span<std::byte> buffer) const {
  const auto bytes = buffer.first(extent.bytes);
  RAYMILL_RETURN_IF_ERROR(file_.read(extent.place, bytes));
  if (storage::checksum(bytes) != extent.checksum) {
    return {ErrorCode::checksum_mismatch, "waiting rays came back from a temporary file in " + config_.directory +
                                              " other than they went; check that disk"};
  }
  return {};
}

WaitingRays::PartHeader WaitingRays::read_header(std::span<const std::byte> buffer, std::size_t& at) {
  PartHeader header;
  std::memcpy(&header, buffer.data() + at, sizeof header);
  at += sizeof header;
  return header;
}

void WaitingRays::append_records(const PartHeader& header, std::span<const std::byte> records) {
  RayQueue& queue = queues_[header.page];
  for (std::size_t at = 0; at < records.size();) {
    const std::size_t bytes = config_.layout.bytes(records.data() + at);
    std::byte* record = pool_->append(queue, bytes);
    assert(record != nullptr);
    std::memcpy(record, records.data() + at, bytes);
    at += bytes;
  }
  groups_[header.page / config_.group_pages].memory_rays += header.rays;
}

}  // namespace raymill::traversal
