// Spool: where the rows of detached jobs are kept until they are fetched and dropped.
//
//   SPOOL/raymill-spool-0123456789abcdef/lock            held (flock) as long as this server runs
//                                       /JOB.rows.part   while the job runs
//                                       /JOB.rows        when it is whole
// Each run of a server has a folder of its own below the spool directory. At start, folders of that name whose lock
// nobody holds are left over from a server that was killed: their rows cannot be asked for any more, so they are
// removed; nothing else in the directory is touched. Writer and reader are thread-compatible; Spool is immutable.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "server/file_descriptor.h"
#include "storage/base/status.h"

namespace raymill::server {

/// Writes a job's rows; what is not committed is removed.
class SpoolWriter {
 public:
  SpoolWriter(SpoolWriter&&) = default;
  ~SpoolWriter();
  /// Errors: disk_full, io.
  Status append(std::span<const std::byte> rows);
  /// Gives the file its lasting name.
  Status commit();

 private:
  friend class Spool;
  SpoolWriter(FileDescriptor file, std::string path) : file_(std::move(file)), path_(std::move(path)) {}
  FileDescriptor file_;
  std::string path_;
};

class Spool {
 public:
  /// Makes this run's folder below `directory` (empty: TMPDIR, else /tmp) and clears those of dead servers.
  /// `instance`: 16 hexadecimal digits, this run's. Errors: io, disk_full.
  static Result<std::unique_ptr<Spool>> create(const std::string& directory, const std::string& instance);
  ~Spool();  ///< removes this run's folder
  Spool(const Spool&) = delete;
  Spool& operator=(const Spool&) = delete;

  [[nodiscard]] Result<SpoolWriter> write(const std::string& job) const;
  /// Fills `bytes` from `offset` of the committed rows. Errors: io, corrupt (the file is shorter).
  [[nodiscard]] Status read(const std::string& job, std::uint64_t offset, std::span<std::byte> bytes) const;
  void remove(const std::string& job) const;
  [[nodiscard]] const std::string& folder() const { return folder_; }

 private:
  Spool(std::string folder, FileDescriptor lock) : folder_(std::move(folder)), lock_(std::move(lock)) {}
  const std::string folder_;
  FileDescriptor lock_;
};

}  // namespace raymill::server
