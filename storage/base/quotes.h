// A word in quotes, as a sentence names what it was given.
#pragma once

#include <string>
#include <string_view>

namespace raymill {

inline std::string in_quotes(std::string_view text) {
  std::string result = "'";
  result.append(text);
  result.push_back('\'');
  return result;
}

}  // namespace raymill
