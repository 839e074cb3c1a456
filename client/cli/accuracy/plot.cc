#include "client/cli/accuracy/plot.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string_view>
#include <utility>

#include "client/cli/accuracy/font.h"

namespace raymill::client {
namespace {

constexpr int kWidth = kPlotExtent.width, kHeight = kPlotExtent.height;
constexpr int kLeft = 110, kRight = 60, kTop = 60, kBottom = 80;
constexpr int kZeroBand = 50;  // below the decades: where an error of zero stands
constexpr int kScale = 2;      // pixels of a glyph's pixel
constexpr int kLetter = (kGlyphColumns + 1) * kScale, kLine = (kGlyphRows + 2) * kScale;
constexpr int kRadius = 6;
constexpr int kMostDecades = 12;  // further down the axis has no room for its labels

struct Box {
  int x = 0, y = 0, width = 0, height = 0;
  [[nodiscard]] bool meets(const Box& other) const {
    return x < other.x + other.width && other.x < x + width && y < other.y + other.height && other.y < y + height;
  }
};

class Canvas {
 public:
  Canvas() : pixels_(std::size_t(kWidth) * kHeight, Ink::paper) {}

  void dot(int x, int y, Ink ink) {
    if (x >= 0 && x < kWidth && y >= 0 && y < kHeight) {
      pixels_[static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x)] = ink;
    }
  }
  void line(int x0, int y0, int x1, int y1, Ink ink) {
    const int steps = std::max({std::abs(x1 - x0), std::abs(y1 - y0), 1});
    for (int i = 0; i <= steps; ++i) {
      const double s = double(i) / steps;
      dot(static_cast<int>(std::lround(x0 + s * (x1 - x0))), static_cast<int>(std::lround(y0 + s * (y1 - y0))), ink);
    }
  }
  void text(int x, int y, std::string_view words) {
    for (const char character : words) {
      const Glyph& glyph = glyph_of(character);
      for (int row = 0; row < kGlyphRows * kScale; ++row) {
        for (int column = 0; column < kGlyphColumns * kScale; ++column) {
          if ((glyph[static_cast<std::size_t>(row / kScale)] >> (kGlyphColumns - 1 - column / kScale) & 1) != 0) {
            dot(x + column, y + row, Ink::text);
          }
        }
      }
      x += kLetter;
    }
  }
  void disc(int x, int y, bool filled) {
    for (int dy = -kRadius; dy <= kRadius; ++dy) {
      for (int dx = -kRadius; dx <= kRadius; ++dx) {
        const int square = dx * dx + dy * dy;
        if (square <= kRadius * kRadius) {
          dot(x + dx, y + dy, filled || square > (kRadius - 2) * (kRadius - 2) ? Ink::point : Ink::paper);
        }
      }
    }
  }
  std::vector<Ink> take() { return std::move(pixels_); }

 private:
  std::vector<Ink> pixels_;
};

int width_of(std::string_view words) { return static_cast<int>(words.size()) * kLetter; }

// The least of 1, 2, 5, 10, ... that makes at most eight steps up to `most`.
double step_of(double most) {
  const double decade = std::pow(10.0, std::floor(std::log10(most / 8)));
  for (const double step : {decade, 2 * decade, 5 * decade}) {
    if (most / step <= 8) {
      return step;
    }
  }
  return 10 * decade;
}

class Axes {
 public:
  explicit Axes(std::span<const PlotPoint> points) {
    double least = 0, most = 0;
    for (const PlotPoint& point : points) {
      most_rate_ = std::max(most_rate_, 1.15 * point.rate);
      if (point.error > 0) {
        least = least == 0 ? point.error : std::min(least, point.error);
        most = std::max(most, point.error);
      }
    }
    if (most > 0) {
      high_ = static_cast<int>(std::floor(std::log10(most))) + 1;
      low_ = std::max(static_cast<int>(std::floor(std::log10(least))), high_ - kMostDecades);
    }
  }

  [[nodiscard]] int x(double rate) const {
    return kLeft + static_cast<int>(std::lround(rate / most_rate_ * (kWidth - kLeft - kRight)));
  }
  [[nodiscard]] int y(double error) const {
    if (error <= 0) {
      return kHeight - kBottom - kZeroBand / 4;
    }
    const double place = std::clamp((std::log10(error) - low_) / (high_ - low_), 0.0, 1.0);
    const int bottom = kHeight - kBottom - kZeroBand;
    return bottom - static_cast<int>(std::lround(place * (bottom - kTop)));
  }

  void draw(Canvas& canvas) const {
    const int bottom = kHeight - kBottom;
    for (int decade = low_; decade <= high_; ++decade) {
      row(canvas, y(std::pow(10.0, decade)), "1e" + std::to_string(decade));
    }
    row(canvas, y(0), "0");
    const double step = step_of(most_rate_);
    for (int i = 0; i * step <= most_rate_; ++i) {
      char text[32];
      std::snprintf(text, sizeof text, "%g", i * step);
      canvas.line(x(i * step), kTop, x(i * step), bottom, Ink::grid);
      canvas.text(x(i * step) - width_of(text) / 2, bottom + 10, text);
    }
    canvas.line(kLeft, kTop, kLeft, bottom, Ink::axis);
    canvas.line(kLeft, bottom, kWidth - kRight, bottom, Ink::axis);
    canvas.text(kLeft / 4, 12, "largest error of t (scene units), hollow: wrong hits or misses");
    constexpr std::string_view kRates = "million rays per second";
    canvas.text(kWidth - kRight - width_of(kRates), kHeight - 30, kRates);
  }

 private:
  static void row(Canvas& canvas, int y, const std::string& label) {
    canvas.line(kLeft, y, kWidth - kRight, y, Ink::grid);
    canvas.text(kLeft - 10 - width_of(label), y - kGlyphRows * kScale / 2, label);
  }

  double most_rate_ = 1e-9;
  int low_ = -1, high_ = 0;  // decades
};

// Beside its point, right or left of it and as little above or below as what stands there already allows.
Box place_of_label(const PlotPoint& point, const Axes& axes, std::span<const Box> taken) {
  constexpr int kMostLines = 12;
  const int width = width_of(point.label), x = axes.x(point.rate), y = axes.y(point.error) - kGlyphRows * kScale / 2;
  const Box sides[] = {{x + 2 * kRadius, y, width, kLine}, {x - 2 * kRadius - width, y, width, kLine}};
  for (int step = 0; step <= 2 * kMostLines; ++step) {
    const int lines = step % 2 == 0 ? -step / 2 : step / 2 + 1;
    for (Box box : sides) {
      box.y += lines * kLine;
      const bool fits =
          box.x >= kLeft && box.x + width <= kWidth && box.y >= kTop - kLine && box.y + kLine <= kHeight - kBottom;
      if (fits && std::none_of(taken.begin(), taken.end(), [&](const Box& other) { return box.meets(other); })) {
        return box;
      }
    }
  }
  return sides[0];
}

}  // namespace

std::array<float, 3> colour_of(Ink ink) {
  switch (ink) {
    case Ink::paper:
      return {1, 1, 1};
    case Ink::grid:
      return {0.8F, 0.8F, 0.8F};
    case Ink::axis:
    case Ink::text:
      return {0, 0, 0};
    case Ink::front:
      return {0.8F, 0.3F, 0.05F};
    case Ink::point:
      return {0.02F, 0.15F, 0.6F};
  }
  return {};
}

std::vector<Ink> draw_plot(std::span<const PlotPoint> points) {
  Canvas canvas;
  const Axes axes(points);
  axes.draw(canvas);
  std::vector<const PlotPoint*> front;
  for (const PlotPoint& point : points) {
    if (point.is_on_front) {
      front.push_back(&point);
    }
  }
  std::sort(front.begin(), front.end(), [](const auto* a, const auto* b) { return a->rate < b->rate; });
  for (std::size_t i = 1; i < front.size(); ++i) {
    const PlotPoint &a = *front[i - 1], &b = *front[i];
    canvas.line(axes.x(a.rate), axes.y(a.error), axes.x(b.rate), axes.y(b.error), Ink::front);
    canvas.line(axes.x(a.rate), axes.y(a.error) + 1, axes.x(b.rate), axes.y(b.error) + 1, Ink::front);
  }
  std::vector<Box> taken;
  for (const PlotPoint& point : points) {
    taken.push_back({axes.x(point.rate) - kRadius, axes.y(point.error) - kRadius, 2 * kRadius, 2 * kRadius});
  }
  for (const PlotPoint& point : points) {
    const Box label = place_of_label(point, axes, taken);
    taken.push_back(label);
    const int x = axes.x(point.rate), y = axes.y(point.error), middle = label.y + kGlyphRows * kScale / 2;
    if (middle != y) {  // it stands apart
      canvas.line(x, y, label.x > x ? label.x - kScale : label.x + label.width, middle, Ink::axis);
    }
    canvas.disc(x, y, point.is_sound);
    canvas.text(label.x, label.y, point.label);
  }
  return canvas.take();
}

}  // namespace raymill::client
