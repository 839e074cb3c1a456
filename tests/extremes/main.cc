// raymill-extremes: the setups known to break ray tracers, all run, and the page that says what was answered.
//
//   raymill-extremes [--row E3]        runs them and prints the page's lines
//   raymill-extremes --write PAGE.md --openvdb raymill-volume-oracle
//                                      writes the page
//   raymill-extremes --check PAGE.md   fails where the page says anything else; Embree's columns are left out, for they
//                                      depend on the machine, and so OpenVDB need not be asked
// Exit codes: 0; 1 a promise is broken, bits differ, or the page is out of date; 2 it could not be run.
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "tests/extremes/run.h"
#include "tests/support/tool.h"

namespace raymill::extremes {
namespace {

constexpr const char* kHead = R"(# Answers at the extremes

Setups known to break ray tracers, each run by the program that made this page, with its answer in each mode. Every row was
answered in core on every instruction set of the machine, with two threads under the least memory that an engine takes, with
one page there at a time (1 % of the pages of the larger rows), and suspended at every node: the same bits each time. Embree
3.13 had the same triangles and rays; its answers depend on its instruction set. float64 is brute force in long double, for
as many rays as are soon done; where it is certain, `watertight` and `exact` hit and miss as it does, and t of `exact` is its
t rounded once.

In the rows of level sets (E31) OpenVDB stands in Embree's place, with its own ray intersector on the same voxels, and
float64 is the trilinear field, cut in halves until it changes its sign.

`raymill-extremes --write tests/extremes/extremes.md --openvdb PATH/raymill-volume-oracle` makes the page again; a test compares it.

| | setup | promise | fast | watertight | exact | Embree | Embree robust | float64 |
|---|---|---|---|---|---|---|---|---|
)";

constexpr const char* kTail = R"(
Rows of the list that are about configurations rather than setups: E27 (suspended at every node) and E33 (every instruction
set, several threads, little memory) were run for each row above; E23 without the kernel that has one page there at a time.
The float64 half of E10 is a page of its own, [offset.md](offset.md). E32 waits for curves, E30 for motion,
and the spheres of E22 for spheres that are no triangles.
)";

std::string line_of(const Row& row, const Told& told) {
  std::ostringstream line;
  line << "| " << row.id << " | " << row.setup << " | " << row.promise;
  for (const std::string& words : told.modes) {
    line << " | " << words;
  }
  line << " | " << told.embree[0] << " | " << told.embree[1] << " | " << told.truth << " |\n";
  return line.str();
}

// Numbers of ids compare as numbers.
std::vector<Row> sorted_rows() {
  std::vector<Row> rows;
  for (const auto& part : {flat_rows(), mesh_rows(), answer_rows(), placed_rows(), volume_rows()}) {
    rows.insert(rows.end(), part.begin(), part.end());
  }
  std::stable_sort(rows.begin(), rows.end(),
                   [](const Row& a, const Row& b) { return std::stoi(a.id.substr(1)) < std::stoi(b.id.substr(1)); });
  return rows;
}

// The page's lines without Embree's cells, which stand after the sixth bar.
std::vector<std::string> without_embree(const std::string& page) {
  std::vector<std::string> lines;
  std::istringstream text(page);
  for (std::string line; std::getline(text, line);) {
    std::string kept;
    std::size_t cell = 0;
    for (const char c : line) {
      cell += c == '|' ? 1 : 0;
      kept += cell == 7 || cell == 8 ? "" : std::string(1, c);
    }
    lines.push_back(line.starts_with("| E") ? kept : line);
  }
  return lines;
}

bool compare(const std::string& page, const std::string& path) {
  std::ifstream file(path);
  const std::string kept((std::istreambuf_iterator<char>(file)), {});
  const auto ours = without_embree(page), theirs = without_embree(kept);
  for (std::size_t i = 0; i < std::max(ours.size(), theirs.size()); ++i) {
    const std::string here = i < ours.size() ? ours[i] : "", there = i < theirs.size() ? theirs[i] : "";
    if (here != there) {
      std::printf("%s:%zu is out of date\n  says     %s\n  is to be %s\n", path.c_str(), i + 1, there.c_str(),
                  here.c_str());
      return false;
    }
  }
  return true;
}

int main(int argc, char** argv) {
  tests::Tool tool("raymill-extremes", "Answers at the extremes, beside Embree and float64.");
  std::string only, write, check;
  std::string openvdb;
  tool.option("--openvdb", openvdb,
              "raymill-volume-oracle, which asks OpenVDB of level sets; left out: it is not asked")
      .type("PROGRAM");
  const auto row_option = tool.option("--row", only, "This row alone").type("ID");
  tool.option("--write", write, "Write the page").type("PAGE.md").excludes(row_option);
  tool.option("--check", check, "Compare the page, but for Embree's columns").type("PAGE.md").excludes(row_option);
  return tool.run(argc, argv, [&]() -> Result<bool> {
    std::string page = kHead;
    std::vector<std::string> problems;
    for (const Row& row : sorted_rows()) {
      if (only.empty() || row.id == only) {
        const Told told = run(row, openvdb);
        problems.insert(problems.end(), told.problems.begin(), told.problems.end());
        page += line_of(row, told);
        std::printf("%s", line_of(row, told).c_str());
        std::fflush(stdout);
      }
    }
    page += kTail;
    for (const std::string& problem : problems) {
      std::printf("FAILED: %s\n", problem.c_str());
    }
    if (!write.empty() && !(std::ofstream(write) << page)) {
      return {ErrorCode::io, "cannot write " + write};
    }
    return (check.empty() || compare(page, check)) && problems.empty();
  });
}

}  // namespace
}  // namespace raymill::extremes

int main(int argc, char** argv) { return raymill::extremes::main(argc, argv); }
