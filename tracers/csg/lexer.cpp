#include "lexer.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>
#include <system_error>

namespace csg {
namespace {

constexpr bool is_digit(char c) { return c >= '0' && c <= '9'; }
constexpr bool is_space(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }
constexpr bool starts_word(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' || c == '$'; }
constexpr std::array<bool, 256> kSymbols = [] {
  std::array<bool, 256> symbols{};
  for (const char symbol : std::string_view("()[]{},;=!#%*")) symbols[static_cast<unsigned char>(symbol)] = true;
  return symbols;
}();
constexpr bool is_symbol(char c) { return kSymbols[static_cast<unsigned char>(c)]; }

/// Reads what most numbers are, digits with a point among them, and returns where it ends; nullptr where
/// it is anything else. Exact: digits below 2⁵³ and a power of ten that is a double make one rounding
/// (Clinger 1990).
const char* read_short_decimal(const char* first, const char* end, double& number) {
  constexpr double kTen[] = {1, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15};
  constexpr int kMostDigits = 15;
  const bool negative = first < end && *first == '-';
  const char* at = first + negative;
  std::int64_t digits = 0;
  int count = 0, after_point = 0;
  for (; at < end && is_digit(*at); ++at, ++count)
    if (count < kMostDigits) digits = 10 * digits + (*at - '0');
  if (count == 0) return nullptr;
  if (at < end && *at == '.') {
    for (++at; at < end && is_digit(*at); ++at, ++count, ++after_point)
      if (count < kMostDigits) digits = 10 * digits + (*at - '0');
  }
  if (count > kMostDigits || (at < end && (*at == 'e' || *at == 'E'))) return nullptr;
  const double magnitude = static_cast<double>(digits) / kTen[after_point];
  number = negative ? -magnitude : magnitude;
  return at;
}

std::string printable(char c) {
  if (c >= ' ' && c <= '~') return {'\'', c, '\''};
  char hex[16];
  std::snprintf(hex, sizeof hex, "byte 0x%02x", static_cast<unsigned>(static_cast<unsigned char>(c)));
  return hex;
}

}  // namespace

std::string Source::at(std::size_t offset) const {
  const std::string_view before = text.substr(0, offset);
  const auto line = 1 + std::count(before.begin(), before.end(), '\n');
  const std::size_t line_start = before.rfind('\n') + 1;  // npos + 1 is 0: the first line
  return name + ":" + std::to_string(line) + ":" + std::to_string(offset - line_start + 1);
}

void Source::fail(std::size_t offset, const std::string& message) const {
  throw ModelError(at(offset) + ": " + message);
}

std::string Token::quoted() const {
  constexpr std::size_t kLongest = 40;
  if (kind == TokenKind::End) return "end of file";
  if (kind == TokenKind::String) return "a string";
  std::string result = "'";
  result += text.substr(0, kLongest);
  return result += text.size() > kLongest ? "...'" : "'";
}

/// And the space behind them.
void Lexer::skip_comments() {
  const std::string_view text = source_.text;
  while (offset_ < text.size() && text[offset_] == '/') {
    const std::string_view start = text.substr(offset_, 2);
    if (start == "//") {
      offset_ = std::min(text.find('\n', offset_), text.size());
    } else if (start == "/*") {
      const std::size_t close = text.find("*/", offset_ + 2);
      if (close == std::string_view::npos) source_.fail(offset_, "comment without an end");
      offset_ = close + 2;
    } else {
      return;
    }
    while (offset_ < text.size() && is_space(text[offset_])) ++offset_;
  }
}

Token Lexer::next() {
  const std::size_t end = source_.text.size();
  while (offset_ < end && is_space(source_.text[offset_])) ++offset_;
  if (offset_ < end && source_.text[offset_] == '/') skip_comments();
  if (offset_ == end) return {TokenKind::End, 0, {}, offset_};
  const char c = source_.text[offset_];
  if (starts_word(c)) return word();
  if (is_digit(c) || c == '-' || c == '+' || c == '.') return number();
  if (c == '"') return string();
  if (!is_symbol(c)) source_.fail(offset_, "unexpected " + printable(c));
  const std::size_t begin = offset_++;
  return {TokenKind::Symbol, c, {source_.text.data() + begin, 1}, begin};
}

Token Lexer::word() {
  const std::size_t begin = offset_;
  while (offset_ < source_.text.size() && (starts_word(source_.text[offset_]) || is_digit(source_.text[offset_]))) {
    ++offset_;
  }
  return {TokenKind::Word, 0, source_.text.substr(begin, offset_ - begin), begin};
}

/// Decimal numbers, and the `nan`, `-nan`, `inf`, `-inf` that OpenSCAD prints; those without a sign
/// come as words.
Token Lexer::number() {
  const std::size_t begin = offset_;
  const char* const text = source_.text.data();
  const char* const end = text + source_.text.size();
  const char* first = text + begin;
  if (*first == '+' && first + 1 < end && first[1] != '-') ++first;  // from_chars takes no plus
  Token token{TokenKind::Number, 0, {}, begin};
  const char* last = read_short_decimal(first, end, token.number);
  if (!last) {
    const auto [stop, error] = std::from_chars(first, end, token.number);
    if (error == std::errc::result_out_of_range) {
      source_.fail(begin, "a number beyond the range of double");
    }
    if (error != std::errc()) source_.fail(begin, "a malformed number");
    last = stop;
  }
  offset_ = static_cast<std::size_t>(last - text);
  if (offset_ < source_.text.size() && (starts_word(*last) || *last == '.')) {
    source_.fail(begin, "a malformed number");
  }
  token.text = source_.text.substr(begin, offset_ - begin);
  return token;
}

/// OpenSCAD 2021.01 writes strings without escapes: text("a\"b") comes out as text = "a"b". So a
/// quote ends the string only before what may follow a value.
Token Lexer::string() {
  const std::string_view text = source_.text;
  const std::size_t begin = offset_ + 1;
  for (std::size_t i = begin; i < text.size(); ++i) {
    if (text[i] == '\\') {
      ++i;
    } else if (text[i] == '"') {
      std::size_t after = i + 1;
      while (after < text.size() && is_space(text[after])) ++after;
      if (after == text.size() || std::string_view(",)]").find(text[after]) != std::string_view::npos) {
        offset_ = i + 1;
        return {TokenKind::String, 0, text.substr(begin, i - begin), begin - 1};
      }
    }
  }
  source_.fail(begin - 1, "string without an end");
}

}  // namespace csg
