#include "storage/import/vdb_import.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <climits>
#include <cmath>
#include <cstdlib>

#include "storage/import/byte_source.h"
#include "storage/import/child_stream.h"
#include "storage/import/message.h"
#include "storage/import/vdb/brick_stream.h"

namespace raymill::storage {
namespace {

// OpenVDB writes 0x56444220 as a 64-bit number.
constexpr std::array<char, 4> kVdbMagic{' ', 'B', 'D', 'V'};

Status cut_short(const std::string& path) {
  return {ErrorCode::bad_scene, path + ": the stream of its bricks ends early; the file is damaged or was cut short"};
}

template <typename T>
bool get(ChildStream& stream, T& value) {
  return stream.read(std::as_writable_bytes(std::span(&value, 1)));
}

bool get_text(ChildStream& stream, std::uint32_t bytes, std::string& text) {
  if (bytes > kMostGridNameBytes) {
    return false;
  }
  text.resize(bytes);
  return stream.read(std::as_writable_bytes(std::span(text)));
}

// What the program said where it failed, else that its stream was cut.
Status end_of(const std::string& path, ChildStream& stream) {
  const Status status = stream.finish();
  return status.ok() ? cut_short(path)
                     : Status(status.code(), message(path, ": cannot be read as an OpenVDB file (", status.message(),
                                                     "); it is damaged or was cut short, copy or write it again"));
}

bool is_sound(const StreamGrid& grid) {
  bool sound = std::isfinite(grid.background);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    sound = sound && grid.origin[axis] > -kMostVolumeIndex && grid.origin[axis] < kMostVolumeIndex &&
            grid.cells[axis] > 0 && grid.cells[axis] <= cells_of_level(kMostVolumeLevels);
    for (const double entry : grid.world_from_index[axis]) {
      sound = sound && std::isfinite(entry);
    }
  }
  return sound;
}

const char* why_left_out(GridState state) {
  switch (state) {
    case GridState::empty:
      return "holds no active voxel";
    case GridState::unsupported_transform:
      return "has a transform that is not linear (a frustum)";
    default:
      return "holds values that are not float32";
  }
}

}  // namespace

Result<bool> is_vdb(const std::string& path) {
  RAYMILL_ASSIGN_OR_RETURN(const ByteSource file, ByteSource::open(path));
  std::array<char, kVdbMagic.size()> head{};
  if (file.size_bytes() >= head.size()) {
    RAYMILL_RETURN_IF_ERROR(file.read(0, std::as_writable_bytes(std::span(head))));
  }
  return head == kVdbMagic || path.ends_with(".vdb");
}

Result<std::string> vdb_reader_program() {
  if (const char* given = std::getenv("RAYMILL_VDB_READER"); given != nullptr) {
    return ::access(given, X_OK) == 0
               ? Result<std::string>(given)
               : Status(ErrorCode::not_found, std::string("RAYMILL_VDB_READER names no program: ") + given);
  }
  std::array<char, PATH_MAX> path{};
  const ssize_t length = ::readlink("/proc/self/exe", path.data(), path.size());
  const std::string_view text(path.data(), static_cast<std::size_t>(std::max<ssize_t>(length, 0)));
  const std::string folder(text.substr(0, text.rfind('/') + 1));
  for (const char* place : {"raymill-vdb", "../libexec/raymill/raymill-vdb"}) {
    if (::access((folder + place).c_str(), X_OK) == 0) {
      return folder + place;
    }
  }
  return Status(ErrorCode::not_found, "raymill-vdb, which reads OpenVDB files, is neither in " + folder + " nor in " +
                                          folder + "../libexec/raymill; set RAYMILL_VDB_READER to it");
}

Result<std::vector<VdbGrid>> list_vdb(const std::string& path, const std::vector<std::string>& only,
                                      ImportReport& report) {
  RAYMILL_ASSIGN_OR_RETURN(const std::string program, vdb_reader_program());
  RAYMILL_ASSIGN_OR_RETURN(ChildStream stream, ChildStream::start({program, "list", path}));
  StreamHead head;
  if (!get(stream, head) || head.magic != kStreamMagic || head.count > kMostGrids) {
    return end_of(path, stream);
  }
  std::vector<VdbGrid> grids;
  std::string left_out;
  bool asked_for = only.empty();
  for (std::uint32_t i = 0; i < head.count; ++i) {
    StreamGrid from;
    VdbGrid to;
    std::string type;
    if (!get(stream, from) || !get_text(stream, from.name_bytes, to.grid.name) ||
        !get_text(stream, from.type_bytes, type)) {
      return end_of(path, stream);
    }
    if (!only.empty() && std::find(only.begin(), only.end(), to.grid.name) == only.end()) {
      continue;
    }
    asked_for = true;
    if (from.state != GridState::fog && from.state != GridState::level_set) {
      ++report.counts[ImportCode::left_out_grids];
      left_out +=
          message(left_out.empty() ? "" : "; ", "grid '", to.grid.name, "' (", type, ") ", why_left_out(from.state));
      continue;
    }
    if (!is_sound(from)) {
      return {ErrorCode::bad_scene, message(path, ": grid '", to.grid.name, "' lies beyond what can be indexed")};
    }
    to.index = i;
    to.grid.kind = from.state == GridState::level_set ? VolumeKind::level_set : VolumeKind::fog;
    to.grid.origin = from.origin;
    to.grid.cells = from.cells;
    to.grid.background = from.background;
    to.grid.active_voxels = from.active_voxels;
    to.grid.world_from_index = from.world_from_index;
    grids.push_back(std::move(to));
  }
  if (!stream.finish().ok()) {
    return end_of(path, stream);
  }
  if (!asked_for) {
    return {ErrorCode::bad_scene, message(path, ": has no grid of the names that were asked for")};
  }
  if (grids.empty()) {
    return {ErrorCode::unsupported,
            message(path, ": holds no grid that Raymill traces, a fog volume or a level set of float32: ",
                    left_out.empty() ? "it holds none at all" : left_out)};
  }
  return grids;
}

Status read_vdb(const std::string& path, const VdbGrid& grid, BrickSink& sink) {
  RAYMILL_ASSIGN_OR_RETURN(const std::string program, vdb_reader_program());
  RAYMILL_ASSIGN_OR_RETURN(ChildStream stream, ChildStream::start({program, "read", path, std::to_string(grid.index)}));
  StreamHead head;
  if (!get(stream, head) || head.magic != kStreamMagic) {
    return end_of(path, stream);
  }
  std::array<float, kBrickValues> values{};
  StreamRecord record;
  for (std::uint64_t count = 0;; ++count) {
    if (!get(stream, record)) {
      return end_of(path, stream);
    }
    Status status;
    if (record.kind == RecordKind::end && record.count == count) {
      break;
    }
    if (record.kind == RecordKind::brick && get(stream, values)) {
      status = sink.add_brick(record.origin, values);
    } else if (record.kind == RecordKind::tile && record.level < kMostVolumeLevels) {
      status = sink.add_tile(record.origin, record.level, record.value);
    } else {
      return end_of(path, stream);
    }
    if (!status.ok()) {
      return status.code() == ErrorCode::bad_scene ? in_context(path, status) : status;
    }
  }
  return stream.finish().ok() ? Status() : end_of(path, stream);
}

}  // namespace raymill::storage
