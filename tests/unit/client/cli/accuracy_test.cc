// What `raymill accuracy` counts, chooses and draws.
#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>

#include "client/cli/accuracy/font.h"
#include "client/cli/accuracy/plot.h"
#include "client/cli/accuracy/row_file.h"
#include "client/cli/accuracy/settings.h"
#include "client/cli/accuracy/tally.h"
#include "tests/unit/client/cli/folder.h"

namespace raymill::client {
namespace {

constexpr float kNever = std::numeric_limits<float>::infinity();
constexpr float kNotANumber = std::numeric_limits<float>::quiet_NaN();

TEST(Spread, TellsWholeNumbersExactlyAndOthersWithinOnePart) {
  Spread spread;
  EXPECT_EQ(spread.at(0.5), 0);
  for (int i = 100; i >= 1; --i) {
    spread.add(i);
  }
  EXPECT_EQ(spread.at(0.5), 50);
  EXPECT_EQ(spread.at(0.99), 99);
  EXPECT_EQ(spread.at(1), 100);
  EXPECT_EQ(spread.most(), 100);
  Spread small;
  for (int i = 0; i < 1000; ++i) {
    small.add(1e-9 * (1 + i * 1e-3));
  }
  EXPECT_NEAR(small.at(0.5), 1.5e-9, 1.5e-11);
  small.add(7);
  EXPECT_EQ(small.most(), 7) << "the largest is kept as it is";
}

TEST(UlpsBetween, CountsFloatsAcrossZero) {
  EXPECT_EQ(ulps_between(1, std::nextafter(1.0F, 2.0F)), 1U);
  EXPECT_EQ(ulps_between(2, std::nextafter(2.0F, 1.0F)), 1U) << "below a power of two too";
  EXPECT_EQ(ulps_between(0.0F, -0.0F), 0U);
  EXPECT_EQ(ulps_between(0x1p-149F, -0x1p-149F), 2U);
  EXPECT_EQ(ulps_between(1, 2), 1U << 23);
}

TEST(Tally, AHitAtTheOraclesTIsRightWhateverItsPrimitive) {
  const Truth truth{.t = 2, .geometry_id = 0, .primitive_id = 7, .dir_length = 10};
  Tally tally;
  tally.add(truth, {.t = 2, .primitive_id = 7, .geometry_id = 0}, false);
  tally.add(truth, {.t = 2, .primitive_id = 8, .geometry_id = 0}, false);
  EXPECT_EQ(tally.wrong_primitives(), 0U);
  EXPECT_EQ(tally.t_units().most(), 0);
  tally.add(truth, {.t = 2.5F, .primitive_id = 7, .geometry_id = 1}, false);
  EXPECT_EQ(tally.wrong_primitives(), 1U);
  tally.add(truth, {.t = std::nextafter(2.0F, 3.0F), .primitive_id = 7, .geometry_id = 0}, false);
  EXPECT_EQ(tally.wrong_primitives(), 1U) << "the same one at another t is an error of t alone";
  EXPECT_EQ(tally.t_units().most(), 5) << "half a length of dir";
  EXPECT_EQ(tally.t_ulps().at(0.75), 1);
  EXPECT_EQ(tally.wrong_hits() + tally.wrong_misses(), 0U);
}

TEST(Tally, CountsEachWayToBeWrong) {
  Tally tally;
  tally.add({.t = 1}, {}, true);
  tally.add({.t = kNever}, {.t = 1, .primitive_id = 0, .geometry_id = 0}, false);
  tally.add({.t = kNever}, {}, false);
  tally.add({.t = kNotANumber}, {.t = kNotANumber}, false);
  EXPECT_EQ(tally.rays(), 4U);
  EXPECT_EQ(tally.invalid(), 1U);
  EXPECT_EQ(tally.oracle_hits(), 1U);
  EXPECT_EQ(tally.wrong_misses(), 1U);
  EXPECT_EQ(tally.wrong_hits(), 1U);
  EXPECT_EQ(tally.inside(), 1U);
  EXPECT_EQ(tally.leaks(), 1U);
  EXPECT_EQ(tally.t_ulps().count(), 0U);
}

TEST(Tally, AHitBeyondTheToleranceLiesOnAnotherSurface) {
  Tally tally;
  const Truth truth{.t = 5, .dir_length = 2};
  const Hit hit{.t = 5.5F, .u = kProxyBarycentric, .primitive_id = 0, .geometry_id = 0};
  tally.add(truth, hit, false, 1);
  EXPECT_EQ(tally.wrong_surfaces(), 0U);
  EXPECT_EQ(tally.t_units().most(), 1);
  tally.add(truth, hit, false, 0.5);
  EXPECT_EQ(tally.wrong_surfaces(), 1U);
  EXPECT_EQ(tally.t_units().count(), 1U) << "it is no error of t";
  EXPECT_EQ(tally.proxy_hits(), 2U);
  EXPECT_EQ(tally.oracle_hits(), 2U);
}

TEST(TruthOf, KeepsTheLengthOfDir) {
  const Truth truth = truth_of({.dir = {3, 0, -4}}, {.t = 1, .primitive_id = 5, .geometry_id = 6});
  EXPECT_EQ(truth.dir_length, 5);
  EXPECT_EQ(truth.primitive_id, 5U);
  EXPECT_EQ(truth.geometry_id, 6U);
  EXPECT_TRUE(std::isfinite(truth_of({.dir = {1e30F, 1e30F, 0}}, {}).dir_length)) << "the squares are no float32";
}

TEST(BeginsInside, NeedsABackSideClearOfEdgesAndOfTheOrigin) {
  const Ray ray{.dir = {0, 0, 1}};
  const Hit behind{.t = 1, .u = 0.25F, .v = 0.25F, .normal = {0, 0, 1}};
  EXPECT_TRUE(begins_inside(ray, behind));
  Hit hit = behind;
  hit.normal = {0, 0, -1};
  EXPECT_FALSE(begins_inside(ray, hit)) << "a front side";
  hit = behind;
  hit.u = 0;
  EXPECT_FALSE(begins_inside(ray, hit)) << "on an edge: a ray from outside may touch it";
  hit.u = 0.75F;
  EXPECT_FALSE(begins_inside(ray, hit)) << "on the third edge";
  hit = behind;
  hit.t = 1e-9F;
  Ray far = ray;
  far.org = {1000, 0, 0};
  EXPECT_FALSE(begins_inside(far, hit)) << "it begins on the surface";
  far = ray;
  far.tfar = 2;
  EXPECT_FALSE(begins_inside(far, behind)) << "a ray with an end may stay inside";
  EXPECT_FALSE(begins_inside(ray, {}));
}

Setting setting(double rate, double error, std::uint64_t wrong = 0) {
  Setting result;
  result.mega_rays_per_second = {rate};
  result.answers.t_units.most = error;
  result.answers.wrong_misses = wrong;
  return result;
}

TEST(FastestWithin, IsTheFastestThatKeepsTheToleranceAndHasNoWrongAnswer) {
  const std::vector<Setting> settings = {setting(5, 1e-3, 1), setting(4, 1e-3), setting(3, 1e-6), setting(2, 0)};
  EXPECT_EQ(fastest_within(settings, {1, 0}), &settings[1]) << "the first has a wrong miss";
  EXPECT_EQ(fastest_within(settings, {1e-3, 0}), &settings[1]) << "the bound is allowed";
  EXPECT_EQ(fastest_within(settings, {1e-4, 0}), &settings[2]);
  EXPECT_EQ(fastest_within(settings, {0, 0}), &settings[3]);
  EXPECT_EQ(fastest_within(std::span(settings).first(2), {0, 0}), nullptr);
  EXPECT_NE(choice_text(settings, {1e-4, 0}).find("--mode watertight"), std::string::npos);
  EXPECT_NE(choice_text(std::span(settings).first(1), {1, 0}).find("none"), std::string::npos);
}

TEST(FastestWithin, AShareOfWrongAnswersMayBeAllowed) {
  std::vector<Setting> settings = {setting(5, 0.1, 3), setting(4, 0)};
  settings[0].answers.rays = 1000;
  settings[0].answers.wrong_surfaces = 2;
  settings[0].manner = {Mode::fast, 0.1, 0};
  EXPECT_EQ(fastest_within(settings, {0.1, 0.004}), &settings[1]) << "another surface is a wrong answer too";
  EXPECT_EQ(fastest_within(settings, {0.1, 0.005}), &settings[0]);
  const std::string text = choice_text(settings, {0.1, 0.005});
  EXPECT_NE(text.find("--mode fast --tolerance 0.1"), std::string::npos) << text;
  EXPECT_NE(text.find("at most 0.005"), std::string::npos) << text;
}

TEST(Manner, AllowsTheLargerOfLengthAndAngle) {
  const Truth truth{.t = 10, .dir_length = 2};
  EXPECT_EQ((Manner{Mode::fast, 0.5, 0.01}).bound(truth), 0.5);
  EXPECT_EQ((Manner{Mode::fast, 0.5, 0.1}).bound(truth), 2);
  EXPECT_TRUE(std::isinf(Manner{}.bound(truth)));
  EXPECT_EQ(manner_text({Mode::fast, 0.5, 0}), "fast +-0.5");
}

TEST(ParetoFront, LeavesOutWhatAnotherBeats) {
  const std::vector<Setting> settings = {setting(1, 0),   setting(2, 0), setting(3, 1),
                                         setting(2.5, 2), setting(4, 3), setting(4, 5)};
  EXPECT_EQ(pareto_front(settings), (std::vector<std::size_t>{1, 2, 4}));
  EXPECT_TRUE(pareto_front({}).empty());
}

TEST(SettingsText, HasALineForEachAndLeaksWhereTheyAreCounted) {
  std::vector<Setting> settings = {setting(1, 0), setting(2, 0.5)};
  settings[1].store = "folder/a-store-with-a-very-long-name.mill";
  settings[1].answers.rays = 200;
  const std::string text = settings_text(settings, false), with_leaks = settings_text(settings, true);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 4);
  EXPECT_EQ(text.find("leaks"), std::string::npos);
  EXPECT_NE(with_leaks.find("leaks"), std::string::npos);
  EXPECT_NE(text.find("a-store-with-a-ve~ "), std::string::npos) << text;
  settings[1].answers.wrong_misses = 1;
  EXPECT_EQ(setting_json(settings[1])["wrong_answer_rate"], 0.005);
}

std::size_t count(const std::vector<Ink>& pixels, Ink ink) {
  return static_cast<std::size_t>(std::count(pixels.begin(), pixels.end(), ink));
}

TEST(Plot, DrawsADiscForEachPointAndALineThroughTheFront) {
  const std::vector<PlotPoint> points = {{.label = "exact", .rate = 1, .error = 0, .is_on_front = true},
                                         {.label = "fast", .rate = 2, .error = 1e-3, .is_on_front = true}};
  const std::vector<Ink> pixels = draw_plot(points);
  ASSERT_EQ(pixels.size(), std::size_t(kPlotExtent.width) * kPlotExtent.height);
  const std::size_t both = count(pixels, Ink::point);
  EXPECT_GT(count(pixels, Ink::front), 100U);
  EXPECT_EQ(count(draw_plot(std::span(points).first(1)), Ink::point) * 2, both);
  std::vector<PlotPoint> hollow = points;
  hollow[1].is_sound = false;
  EXPECT_LT(count(draw_plot(hollow), Ink::point), both);
}

TEST(Plot, HoldsAnyNumbers) {
  std::vector<PlotPoint> points;
  for (int i = 0; i < 12; ++i) {
    points.push_back({.label = "watertight lattice:0.000123", .rate = 1e-6, .error = std::pow(10.0, 3 * i - 30)});
  }
  const std::vector<Ink> pixels = draw_plot(points);
  EXPECT_GT(count(pixels, Ink::text), 1000U);
  EXPECT_GT(count(draw_plot({}), Ink::axis), 100U);
}

TEST(Font, HasLettersOfBothCasesAndAFrameForTheRest) {
  EXPECT_EQ(glyph_of('A'), glyph_of('a'));
  EXPECT_NE(glyph_of('M'), glyph_of('m'));
  EXPECT_EQ(glyph_of('\x80'), glyph_of('~'));
  EXPECT_EQ(glyph_of(' '), Glyph{});
}

class RowFileTest : public FolderTest {};

TEST_F(RowFileTest, GivesRowsBackInOrderToEachReader) {
  for (const std::size_t count : {std::size_t{0}, std::size_t{1}, RowFile<int>::kRows, 3 * RowFile<int>::kRows + 5}) {
    RowFile<int> file(folder_.string(), "numbers");
    for (std::size_t i = 0; i < count; ++i) {
      ASSERT_TRUE(file.append(static_cast<int>(i)).ok());
    }
    ASSERT_TRUE(file.finish().ok());
    RowFile<int>::Reader reader(file);
    for (const std::size_t most : {std::size_t{1000}, std::size_t{100000}}) {
      std::vector<int> read;
      while (true) {
        const auto rows = reader.next(most);
        ASSERT_TRUE(rows) << rows.status().message();
        if (rows->empty()) {
          break;
        }
        EXPECT_LE(rows->size(), most);
        read.insert(read.end(), rows->begin(), rows->end());
      }
      std::vector<int> expected(count);
      std::iota(expected.begin(), expected.end(), 0);
      EXPECT_EQ(read, expected);
      reader.rewind();
    }
  }
  EXPECT_EQ(files(), 0U) << "it has no name";
}

TEST_F(RowFileTest, SaysWhereThereIsNoRoom) {
  RowFile<int> file(path("nowhere"), "numbers");
  ASSERT_TRUE(file.append(1).ok());
  const Status status = file.finish();
  EXPECT_EQ(status.code(), ErrorCode::io);
  EXPECT_NE(status.message().find("numbers"), std::string::npos);
}

}  // namespace
}  // namespace raymill::client
