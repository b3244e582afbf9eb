// The text of a .csg file, cut into tokens that know where they stand.
#pragma once
#include <cstddef>
#include <string>
#include <string_view>

#include "csg_tree.hpp"

namespace csg {

/// A named text. Positions are byte offsets; lines and columns are counted only for a message.
struct Source {
  std::string_view text;
  std::string name;

  /// `name:line:col`, both from 1; a column is a byte.
  std::string at(std::size_t offset) const;
  [[noreturn]] void fail(std::size_t offset, const std::string& message) const;
};

enum class TokenKind : std::uint8_t { End, Word, Number, String, Symbol };

struct Token {
  TokenKind kind = TokenKind::End;
  char symbol = 0;        ///< of a Symbol
  std::string_view text;  ///< as it stands in the source; a string without its quotes
  std::size_t offset = 0;
  double number = 0;

  bool is(char other) const { return symbol == other; }
  std::string quoted() const;  ///< for messages
};

class Lexer {
 public:
  explicit Lexer(const Source& source) : source_(source) {}
  Token next();

 private:
  void skip_comments();
  Token word();
  Token number();
  Token string();

  const Source& source_;
  std::size_t offset_ = 0;
};

}  // namespace csg
