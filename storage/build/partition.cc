#include "storage/build/partition.h"

#include <algorithm>
#include <iterator>
#include <memory>
#include <queue>
#include <utility>

#include "storage/build/cell_grid.h"
#include "storage/build/cell_pass.h"

namespace raymill::storage {
namespace {

// The tree while it grows: a leaf has a bucket.
struct Part {
  Aabb box;
  std::uint64_t count = 0;
  std::unique_ptr<Part> left, right;
  TriangleBucket bucket;
};

std::unique_ptr<Part> leaf(TriangleBucket bucket) {
  auto part = std::make_unique<Part>();
  part->box = bucket.box;
  part->count = bucket.count;
  part->bucket = std::move(bucket);
  return part;
}

std::unique_ptr<Part> join(std::unique_ptr<Part> left, std::unique_ptr<Part> right) {
  auto part = std::make_unique<Part>();
  part->box.grow(left->box);
  part->box.grow(right->box);
  part->count = left->count + right->count;
  part->left = std::move(left);
  part->right = std::move(right);
  return part;
}

// Copies `part` depth first and takes its buckets; returns the node's index.
std::uint32_t flatten(Part& part, Partition& out) {
  const auto index = static_cast<std::uint32_t>(out.nodes.size());
  out.nodes.push_back({part.box, part.count, 0, 0, static_cast<std::uint32_t>(out.runs.size()), 1});
  if (part.left == nullptr) {
    out.runs.push_back(std::move(part.bucket));
    return index;
  }
  const std::uint32_t left = flatten(*part.left, out);
  const std::uint32_t right = flatten(*part.right, out);
  PartitionNode& node = out.nodes[index];
  node.left = left;
  node.right = right;
  node.run_count = static_cast<std::uint32_t>(out.runs.size()) - node.first_run;
  return index;
}

class Partitioner {
 public:
  Partitioner(BlockStore& store, Lattice& lattice, const PartitionConfig& config)
      : store_(store), lattice_(lattice), config_(config) {}

  // `snap`: the triangles were not yet put on the lattice.
  Result<std::unique_ptr<Part>> part(TriangleBucket all, bool snap) {
    if (all.count <= config_.run_triangles && !snap) {
      return leaf(std::move(all));
    }
    std::vector<CellNode> nodes;
    std::vector<TriangleBucket> buckets;
    {
      CellGrid grid(all.middles, all.count);
      RAYMILL_RETURN_IF_ERROR(count_cells(all, snap, grid));
      nodes = grid.partition(config_.run_triangles);
      if (nodes.size() == 1 && nodes[0].count > config_.run_triangles) {
        return split_by_order(std::move(all), snap);
      }
      buckets.resize(nodes.size());
      slot_of_cell_.assign(grid.cell_count(), 0);
      RAYMILL_RETURN_IF_ERROR(distribute(grid, nodes, 0, std::move(all), snap, buckets));
      slot_of_cell_ = std::vector<std::uint32_t>();
    }
    return gather(nodes, 0, buckets);
  }

  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }

 private:
  Status step(std::size_t triangles) {
    handled_ += triangles;
    return config_.progress ? config_.progress(handled_) : Status();
  }

  CellPass pass(const CellGrid& grid, bool consume, bool snap) {
    return {store_, grid, {config_.threads, consume, snap ? &lattice_ : nullptr}};
  }

  Status count_cells(const TriangleBucket& all, bool snap, CellGrid& grid) {
    return pass(grid, false, snap).run(all, [&](const CellBlock& block) {
      for (std::size_t i = 0; i < block.triangles.size(); ++i) {
        grid.add(block.cells[i], block.boxes[i]);
      }
      dropped_ += block.dropped;
      return step(block.triangles.size() + block.dropped);
    });
  }

  // The nodes under `root` among which triangles are handed out at once: the largest are opened first.
  std::vector<std::uint32_t> cut(const std::vector<CellNode>& nodes, std::uint32_t root) const {
    using Entry = std::pair<std::uint64_t, std::uint32_t>;
    std::priority_queue<Entry> open;
    std::vector<std::uint32_t> frontier;
    open.emplace(nodes[root].count, root);
    while (!open.empty()) {
      const std::uint32_t index = open.top().second;
      open.pop();
      const bool full = open.size() + frontier.size() + 2 > config_.most_open_buckets;
      if (nodes[index].is_leaf() || full) {
        frontier.push_back(index);
        continue;
      }
      open.emplace(nodes[nodes[index].left].count, nodes[index].left);
      open.emplace(nodes[nodes[index].right].count, nodes[index].right);
    }
    return frontier;
  }

  // Hands the triangles of `from` to the leaves under `root`, in as many passes as open buckets make necessary.
  Status distribute(const CellGrid& grid, const std::vector<CellNode>& nodes, std::uint32_t root, TriangleBucket from,
                    bool snap, std::vector<TriangleBucket>& out) {
    if (nodes[root].is_leaf() && !snap) {
      out[root] = std::move(from);
      return {};
    }
    const std::vector<std::uint32_t> frontier = cut(nodes, root);
    for (std::uint32_t i = 0; i < frontier.size(); ++i) {
      for (const std::uint32_t cell : grid.cells_of(nodes[frontier[i]])) {
        slot_of_cell_[cell] = i;
      }
    }
    std::vector<BucketWriter> writers(frontier.size(), BucketWriter(store_));
    Status handed_out = pass(grid, true, snap).run(from, [&](const CellBlock& block) -> Status {
      for (std::size_t i = 0; i < block.triangles.size(); ++i) {
        RAYMILL_RETURN_IF_ERROR(writers[slot_of_cell_[block.cells[i]]].add(block.triangles[i], block.boxes[i]));
      }
      return step(block.triangles.size() + block.dropped);
    });
    RAYMILL_RETURN_IF_ERROR(std::move(handed_out));
    std::vector<TriangleBucket> taken(frontier.size());
    for (std::uint32_t i = 0; i < frontier.size(); ++i) {
      RAYMILL_ASSIGN_OR_RETURN(taken[i], writers[i].take());
    }
    writers.clear();
    for (std::uint32_t i = 0; i < frontier.size(); ++i) {
      RAYMILL_RETURN_IF_ERROR(distribute(grid, nodes, frontier[i], std::move(taken[i]), false, out));
    }
    return {};
  }

  // The leaves' buckets become parts; those that are too large still are cut again.
  Result<std::unique_ptr<Part>> gather(const std::vector<CellNode>& nodes, std::uint32_t index,
                                       std::vector<TriangleBucket>& buckets) {
    if (nodes[index].is_leaf()) {
      return part(std::move(buckets[index]), false);
    }
    RAYMILL_ASSIGN_OR_RETURN(std::unique_ptr<Part> left, gather(nodes, nodes[index].left, buckets));
    RAYMILL_ASSIGN_OR_RETURN(std::unique_ptr<Part> right, gather(nodes, nodes[index].right, buckets));
    return join(std::move(left), std::move(right));
  }

  // No plane tells these triangles apart: equal shares in the order given.
  Result<std::unique_ptr<Part>> split_by_order(TriangleBucket all, bool snap) {
    const std::uint64_t shares = (all.count + config_.run_triangles - 1) / config_.run_triangles;
    const std::uint64_t share = (all.count + shares - 1) / shares;
    std::vector<std::unique_ptr<Part>> parts;
    BucketWriter writer(store_);
    std::uint64_t added = 0;
    Status shared_out = pass(CellGrid(all.middles, 1), true, snap).run(all, [&](const CellBlock& block) -> Status {
      for (const Triangle& t : block.triangles) {
        RAYMILL_RETURN_IF_ERROR(writer.add(t));
        if (++added % share == 0) {
          RAYMILL_ASSIGN_OR_RETURN(TriangleBucket bucket, writer.take());
          parts.push_back(leaf(std::move(bucket)));
        }
      }
      return step(block.triangles.size() + block.dropped);
    });
    RAYMILL_RETURN_IF_ERROR(std::move(shared_out));
    if (added % share != 0) {
      RAYMILL_ASSIGN_OR_RETURN(TriangleBucket bucket, writer.take());
      parts.push_back(leaf(std::move(bucket)));
    }
    while (parts.size() > 1) {
      std::vector<std::unique_ptr<Part>> joined;
      for (std::size_t i = 0; i + 1 < parts.size(); i += 2) {
        joined.push_back(join(std::move(parts[i]), std::move(parts[i + 1])));
      }
      if (parts.size() % 2 != 0) {
        joined.push_back(std::move(parts.back()));
      }
      parts = std::move(joined);
    }
    return std::move(parts.front());
  }

  BlockStore& store_;
  Lattice& lattice_;
  const PartitionConfig& config_;
  std::vector<std::uint32_t> slot_of_cell_;
  std::uint64_t handled_ = 0;
  std::uint64_t dropped_ = 0;
};

}  // namespace

Partition join(Partition triangles, Partition instances) {
  if (instances.runs.empty()) {
    return triangles;
  }
  instances.first_instances = 0;
  if (triangles.runs.empty()) {
    return instances;
  }
  Partition both;
  both.dropped_degenerate = triangles.dropped_degenerate;
  both.first_instances = static_cast<std::uint32_t>(triangles.runs.size());
  PartitionNode root{triangles.nodes[0].box, triangles.nodes[0].count + instances.nodes[0].count};
  root.box.grow(instances.nodes[0].box);
  root.run_count = static_cast<std::uint32_t>(triangles.runs.size() + instances.runs.size());
  both.nodes.push_back(root);
  const auto append = [&both](Partition& part) {
    const auto first_node = static_cast<std::uint32_t>(both.nodes.size());
    const auto first_run = static_cast<std::uint32_t>(both.runs.size());
    for (PartitionNode node : part.nodes) {
      node.left += node.is_leaf() ? 0 : first_node;
      node.right += node.right == 0 ? 0 : first_node;
      node.first_run += first_run;
      both.nodes.push_back(node);
    }
    std::move(part.runs.begin(), part.runs.end(), std::back_inserter(both.runs));
    return first_node;
  };
  both.nodes[0].left = append(triangles);
  both.nodes[0].right = append(instances);
  return both;
}

std::uint64_t partition_bytes(std::uint32_t most_open_buckets, unsigned threads, std::uint64_t triangle_count) {
  return most_open_buckets * BucketWriter::bytes() + CellPass::bytes(threads) + CellGrid::bytes(triangle_count);
}

Result<Partition> partition_triangles(BlockStore& store, TriangleBucket all, Lattice& lattice,
                                      const PartitionConfig& config) {
  Partition partition;
  if (all.count == 0) {
    return partition;
  }
  Partitioner partitioner(store, lattice, config);
  RAYMILL_ASSIGN_OR_RETURN(const std::unique_ptr<Part> root, partitioner.part(std::move(all), lattice.active()));
  partition.dropped_degenerate = partitioner.dropped();
  if (root->count > 0) {
    flatten(*root, partition);
  }
  return partition;
}

}  // namespace raymill::storage
