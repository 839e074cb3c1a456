#include "traversal/hit_lists.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <utility>

namespace raymill::traversal {
namespace {

// Blocks of runs whose places are used again: a bit each.
constexpr std::uint32_t kRunPlaces = 16 << 10;
// Of lists of runs and cursors.
constexpr std::uint64_t kTableBytes = 4 << 10;
static_assert(HitLists::kMostRuns * (8 * sizeof(std::uint32_t) + 24) <= kTableBytes, "eight merges of merges");

std::uint32_t items_for(const HitLists::Config& config, std::size_t entry_bytes, std::size_t item_bytes) {
  return static_cast<std::uint32_t>((config.sort_bytes - config.block_bytes) / (entry_bytes + item_bytes));
}

// Those that stand before the ids in a row of kept(asked).
Field fields_before_ids(Field asked) {
  const Field may = Field::t | Field::t_leave | Field::uv;
  return Field::t | Field(std::uint32_t(asked) & std::uint32_t(may));
}

// Rises with t; zeros of both signs are one.
std::uint32_t order_of(float t) {
  const auto bits = std::bit_cast<std::uint32_t>(t + 0.0F);
  return (bits >> 31) != 0 ? ~bits : bits | 1U << 31;
}

}  // namespace

std::uint64_t HitLists::bytes(const Config& config) {
  return config.sort_bytes + std::uint64_t(config.pieces) * (config.piece_bytes + sizeof(std::uint32_t)) + kTableBytes +
         SpillFile::table_bytes(kRunPlaces);
}

HitLists::HitLists(const Config& config)
    : config_(config),
      kept_(kept(config.asked)),
      asked_(config.asked),
      entry_bytes_(RowBlock::entry_bytes(kept_.row_bytes())),
      ids_at_(sizeof(RowBlock::Position) + HitLayout(fields_before_ids(config.asked)).row_bytes()),
      most_items_(items_for(config, entry_bytes_, sizeof(Item))),
      area_(config.sort_bytes),
      pieces_(std::uint64_t(config.pieces) * config.piece_bytes),
      file_({config.directory, "hits", config.block_bytes, kRunPlaces, false}) {
  items_ = reinterpret_cast<Item*>(area_.data());
  entries_ = area_.data() + most_items_ * sizeof(Item);
  out_ = area_.data() + config.sort_bytes - config.block_bytes;
  most_cursors_ = std::min<std::uint32_t>(
      kMostRuns, static_cast<std::uint32_t>((config.sort_bytes - config.block_bytes) / config.block_bytes));
  assert(most_cursors_ >= 2 && most_items_ >= RowBlock::room(config.block_bytes, kept_.row_bytes()));
  for (std::uint32_t i = config.pieces; i-- > 0;) {
    free_pieces_.push_back(i);
  }
}

std::uint32_t HitLists::take_piece() {
  const std::uint32_t piece = free_pieces_.back();
  free_pieces_.pop_back();
  return piece;
}

void HitLists::begin(std::uint32_t rays) {
  assert(rays <= config_.chunk_rays);
  rays_ = rays;
  ray_ = 0;
  given_ = 0;
  item_count_ = next_item_ = 0;
  is_reading_ = is_merging_ = false;
}

// By ray, then t.
std::uint64_t HitLists::key_of(const std::byte* entry) {
  float t;
  std::memcpy(&t, entry + sizeof(RowBlock::Position), sizeof t);
  return std::uint64_t(RowBlock::position_of(entry)) << 32 | order_of(t);
}

PrimitiveIds HitLists::ids_of(const std::byte* entry) const {
  PrimitiveIds ids;
  std::memcpy(&ids.primitive_id, entry + ids_at_, sizeof ids.primitive_id);
  std::memcpy(&ids.geometry_id, entry + ids_at_ + sizeof ids.primitive_id, sizeof ids.geometry_id);
  return ids;
}

void HitLists::sort_items() {
  std::sort(items_, items_ + item_count_, [this](const Item& a, const Item& b) {
    return a.key != b.key ? a.key < b.key : ids_of(a.entry) < ids_of(b.entry);
  });
}

Status HitLists::take(const std::byte* block) {
  const std::uint32_t rows = RowBlock::of(block).rows;
  if (rows > most_items_ - item_count_) {
    RAYMILL_RETURN_IF_ERROR(keep_run());
  }
  std::byte* entries = entries_ + item_count_ * entry_bytes_;
  std::memcpy(entries, RowBlock::entries(block), rows * entry_bytes_);
  for (std::uint32_t i = 0; i < rows; ++i, entries += entry_bytes_) {
    items_[item_count_++] = {key_of(entries), entries};
  }
  return {};
}

// Lets the first hits of each ray pass, of entries that come in order.
class HitLists::FirstOnes {
 public:
  explicit FirstOnes(std::uint64_t most) : most_(most == 0 ? ~std::uint64_t(0) : most) {}
  bool pass(const std::byte* entry) {
    const std::uint32_t ray = RowBlock::position_of(entry);
    seen_ = ray == ray_ ? seen_ + 1 : 1;
    ray_ = ray;
    return seen_ <= most_;
  }

 private:
  const std::uint64_t most_;
  std::uint32_t ray_ = RowBlock::kNone;
  std::uint64_t seen_ = 0;
};

// Writes sorted entries as a chain of blocks.
class HitLists::RunWriter {
 public:
  explicit RunWriter(HitLists& lists) : lists_(lists), first_ones_(lists.config_.first), first_(lists.file_.take()) {
    begin(first_);
  }
  Status add(const std::byte* entry) {
    if (!first_ones_.pass(entry)) {
      return {};
    }
    if (block().rows == RowBlock::room(lists_.config_.block_bytes, lists_.kept_.row_bytes())) {
      RAYMILL_RETURN_IF_ERROR(end(lists_.file_.take()));
    }
    std::memcpy(lists_.out_ + sizeof(RowBlock) + block().rows++ * lists_.entry_bytes_, entry, lists_.entry_bytes_);
    return {};
  }
  /// Gives the run's first place.
  Result<std::uint32_t> finish() {
    RAYMILL_RETURN_IF_ERROR(end(RowBlock::kNone));
    return first_;
  }

 private:
  [[nodiscard]] RowBlock& block() const { return *reinterpret_cast<RowBlock*>(lists_.out_); }
  void begin(std::uint32_t place) {
    place_ = place;
    block() = {};
  }
  Status end(std::uint32_t next) {
    block().next = next;
    block().checksum = RowBlock::checksum_of(lists_.out_, lists_.kept_.row_bytes());
    lists_.spilled_bytes_ += lists_.config_.block_bytes;
    RAYMILL_RETURN_IF_ERROR(lists_.file_.write(place_, {lists_.out_, lists_.config_.block_bytes}));
    begin(next);
    return {};
  }

  HitLists& lists_;
  FirstOnes first_ones_;
  const std::uint32_t first_;
  std::uint32_t place_ = 0;
};

// What the area holds goes to disk, sorted.
Status HitLists::keep_run() {
  sort_items();
  RunWriter writer(*this);
  for (std::uint32_t i = 0; i < item_count_; ++i) {
    RAYMILL_RETURN_IF_ERROR(writer.add(items_[i].entry));
  }
  RAYMILL_ASSIGN_OR_RETURN(const std::uint32_t run, writer.finish());
  item_count_ = 0;
  return add_run(0, run);
}

// As many runs of a level as can be merged become one of the next. The area must be free.
Status HitLists::add_run(std::size_t level, std::uint32_t run) {
  runs_.resize(std::max(runs_.size(), level + 1));
  runs_[level].push_back(run);
  if (runs_[level].size() < most_cursors_) {
    return {};
  }
  const auto full = std::exchange(runs_[level], {});
  RAYMILL_ASSIGN_OR_RETURN(const std::uint32_t merged, merge(full));
  return add_run(level + 1, merged);
}

Result<std::uint32_t> HitLists::merge(std::span<const std::uint32_t> runs) {
  RAYMILL_RETURN_IF_ERROR(begin_merge(runs));
  RunWriter writer(*this);
  while (const std::byte* entry = next_entry()) {
    RAYMILL_RETURN_IF_ERROR(writer.add(entry));
    RAYMILL_RETURN_IF_ERROR(advance());
  }
  is_merging_ = false;
  return writer.finish();
}

Status HitLists::begin_merge(std::span<const std::uint32_t> runs) {
  is_merging_ = true;
  cursors_.clear();
  heap_.clear();
  for (const std::uint32_t run : runs) {
    Cursor& cursor = cursors_.emplace_back();
    cursor.block = area_.data() + (cursors_.size() - 1) * config_.block_bytes;
    RAYMILL_RETURN_IF_ERROR(read_block(run, cursor.block));
    heap_.push_back(static_cast<std::uint32_t>(cursors_.size() - 1));
  }
  std::make_heap(heap_.begin(), heap_.end(), [this](auto a, auto b) { return comes_after(a, b); });
  return {};
}

// Each block is read once; its place is free then.
Status HitLists::read_block(std::uint32_t place, std::byte* block) {
  RAYMILL_RETURN_IF_ERROR(file_.read(place, {block, config_.block_bytes}));
  file_.give(place);
  const RowBlock& head = RowBlock::of(block);
  if (head.rows == 0 || head.rows > RowBlock::room(config_.block_bytes, kept_.row_bytes()) ||
      head.checksum != RowBlock::checksum_of(block, kept_.row_bytes())) {
    return {ErrorCode::checksum_mismatch,
            "hits came back from a temporary file in " + config_.directory + " other than they went; check that disk"};
  }
  return {};
}

const std::byte* HitLists::entry_at(std::uint32_t cursor) const {
  return RowBlock::entries(cursors_[cursor].block) + cursors_[cursor].row * entry_bytes_;
}

bool HitLists::comes_after(std::uint32_t a, std::uint32_t b) const {
  const std::byte *of_a = entry_at(a), *of_b = entry_at(b);
  const std::uint64_t key_a = key_of(of_a), key_b = key_of(of_b);
  return key_a != key_b ? key_a > key_b : ids_of(of_a) > ids_of(of_b);
}

// Sorted entries come from the area, or from runs there are.
Status HitLists::begin_reading() {
  is_reading_ = true;
  if (std::all_of(runs_.begin(), runs_.end(), [](const auto& level) { return level.empty(); })) {
    sort_items();
    return {};
  }
  if (item_count_ > 0) {
    RAYMILL_RETURN_IF_ERROR(keep_run());
  }
  std::vector<std::uint32_t> runs;  // the shortest first
  for (auto& level : runs_) {
    for (const std::uint32_t run : std::exchange(level, {})) {
      runs.push_back(run);
    }
    if (runs.size() > most_cursors_) {
      const auto excess = static_cast<std::ptrdiff_t>(std::min<std::size_t>(runs.size(), most_cursors_));
      RAYMILL_ASSIGN_OR_RETURN(const std::uint32_t merged, merge(std::span(runs).first(std::size_t(excess))));
      runs.erase(runs.begin(), runs.begin() + excess);
      runs.push_back(merged);
    }
  }
  return begin_merge(runs);
}

const std::byte* HitLists::next_entry() const {
  if (is_merging_) {
    return heap_.empty() ? nullptr : entry_at(heap_.front());
  }
  return next_item_ < item_count_ ? items_[next_item_].entry : nullptr;
}

Status HitLists::advance() {
  if (!is_merging_) {
    ++next_item_;
    return {};
  }
  const auto after = [this](std::uint32_t a, std::uint32_t b) { return comes_after(a, b); };
  std::pop_heap(heap_.begin(), heap_.end(), after);
  Cursor& cursor = cursors_[heap_.back()];
  const RowBlock& head = RowBlock::of(cursor.block);
  if (++cursor.row == head.rows) {
    if (head.next == RowBlock::kNone) {
      heap_.pop_back();
      return {};
    }
    cursor.row = 0;
    RAYMILL_RETURN_IF_ERROR(read_block(head.next, cursor.block));
  }
  std::push_heap(heap_.begin(), heap_.end(), after);
  return {};
}

void HitLists::write_row(const std::byte* entry, std::byte* row) const {
  const std::byte* kept = entry + sizeof(RowBlock::Position);
  if (asked_.fields() == kept_.fields()) {
    std::memcpy(row, kept, asked_.row_bytes());
  } else {
    asked_.write(kept_.read(kept), row);
  }
}

Status HitLists::fill(Piece& piece) {
  if (!is_reading_) {
    RAYMILL_RETURN_IF_ERROR(begin_reading());
  }
  std::byte* const memory = pieces_.data() + piece.number * config_.piece_bytes;
  auto* const offsets = reinterpret_cast<std::uint32_t*>(memory);
  std::byte* const rows = memory + (config_.chunk_rays + 1) * sizeof(std::uint32_t);
  const std::size_t row_bytes = asked_.row_bytes();
  const auto room = static_cast<std::uint32_t>((memory + config_.piece_bytes - rows) / row_bytes);
  const std::uint32_t first = ray_;
  std::uint32_t count = 0;
  offsets[0] = 0;
  while (ray_ < rays_) {
    const std::byte* entry = next_entry();
    if (entry == nullptr || RowBlock::position_of(entry) != ray_) {
      offsets[++ray_ - first] = count;
      given_ = 0;
    } else if (config_.first != 0 && given_ == config_.first) {
      RAYMILL_RETURN_IF_ERROR(advance());
    } else if (count < room) {
      write_row(entry, rows + count++ * row_bytes);
      ++given_;
      RAYMILL_RETURN_IF_ERROR(advance());
    } else {
      break;
    }
  }
  piece.is_last = ray_ == rays_;
  piece.goes_on = !piece.is_last && count > offsets[ray_ - first];
  if (piece.goes_on) {
    offsets[ray_ + 1 - first] = count;
  }
  piece.first_position = first;
  piece.offsets = {offsets, ray_ - first + (piece.goes_on ? 2 : 1)};
  piece.rows = {rows, count * row_bytes};
  return {};
}

}  // namespace raymill::traversal
