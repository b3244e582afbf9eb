#include "parser.hpp"

#include <array>
#include <limits>
#include <optional>
#include <utility>

namespace csg {
namespace {

struct NamedKind {
  std::string_view name;
  NodeKind kind;
};

constexpr std::array kKinds = {
    // the most frequent first
    NamedKind{"multmatrix", NodeKind::Multmatrix},
    NamedKind{"group", NodeKind::Group},
    NamedKind{"cylinder", NodeKind::Cylinder},
    NamedKind{"sphere", NodeKind::Sphere},
    NamedKind{"cube", NodeKind::Cube},
    NamedKind{"union", NodeKind::Union},
    NamedKind{"difference", NodeKind::Difference},
    NamedKind{"intersection", NodeKind::Intersection},
    NamedKind{"rotate_extrude", NodeKind::RotateExtrude},
    NamedKind{"circle", NodeKind::Circle},
    NamedKind{"color", NodeKind::Color},
    NamedKind{"render", NodeKind::Render},
    NamedKind{"hull", NodeKind::Hull},
    NamedKind{"minkowski", NodeKind::Minkowski},
    NamedKind{"resize", NodeKind::Resize},
    NamedKind{"polyhedron", NodeKind::Polyhedron},
    NamedKind{"linear_extrude", NodeKind::LinearExtrude},
    NamedKind{"projection", NodeKind::Projection},
    NamedKind{"offset", NodeKind::Offset},
    NamedKind{"import", NodeKind::Import},
    NamedKind{"surface", NodeKind::Surface},
    NamedKind{"square", NodeKind::Square},
    NamedKind{"polygon", NodeKind::Polygon},
    NamedKind{"text", NodeKind::Text},
};

std::optional<NodeKind> kind_named(std::string_view name) {
  for (const NamedKind& entry : kKinds) {
    if (entry.name == name) return entry.kind;
  }
  return std::nullopt;
}

constexpr std::uint32_t index_of(std::size_t i) { return static_cast<std::uint32_t>(i); }

class Parser {
 public:
  explicit Parser(const Source& source) : source_(source), lexer_(source) {}
  SyntaxTree run();

 private:
  void advance() { token_ = lexer_.next(); }
  void expect(char symbol);
  [[noreturn]] void fail_expecting(const std::string& what) const { fail_expecting(what, token_); }
  [[noreturn]] void fail_expecting(const std::string& what, const Token& found) const;

  void node();
  void close_node();
  Modifiers modifiers();
  void argument();
  void value();
  void scalar(const Token& token);

  const Source& source_;
  Lexer lexer_;
  Token token_;
  SyntaxTree tree_;
  std::vector<std::uint32_t> open_nodes_, open_lists_;
};

SyntaxTree Parser::run() {
  // Somewhat more than OpenSCAD's text needs; what is not used is never touched.
  const std::size_t size = source_.text.size();
  tree_.nodes.reserve(size / 64);
  tree_.arguments.reserve(size / 24);
  tree_.values.reserve(size / 6);
  advance();
  while (token_.kind != TokenKind::End) {
    if (token_.is('}')) {
      close_node();
    } else {
      node();
    }
  }
  if (!open_nodes_.empty()) {
    const SyntaxNode& open = tree_.nodes[open_nodes_.back()];
    source_.fail(token_.offset, "end of file, but the " + std::string(name_of(open.kind)) + " of " +
                                    source_.at(open.offset) + " is not closed");
  }
  return std::move(tree_);
}

void Parser::expect(char symbol) {
  if (!token_.is(symbol)) fail_expecting(std::string("'") + symbol + "'");
  advance();
}

void Parser::fail_expecting(const std::string& what, const Token& found) const {
  source_.fail(found.offset, "expected " + what + ", found " + found.quoted());
}

void Parser::node() {
  SyntaxNode node;
  node.modifiers = modifiers();
  if (token_.kind != TokenKind::Word) fail_expecting("a node");
  const std::optional<NodeKind> kind = kind_named(token_.text);
  if (!kind) source_.fail(token_.offset, "unknown node kind " + token_.quoted());
  node.kind = *kind;
  node.offset = index_of(token_.offset);
  node.first_argument = index_of(tree_.arguments.size());
  advance();
  expect('(');
  if (!token_.is(')')) {
    argument();
    while (token_.is(',')) {
      advance();
      argument();
    }
  }
  if (!token_.is(')')) fail_expecting("',' or ')'");
  advance();
  node.end_argument = index_of(tree_.arguments.size());
  node.end = index_of(tree_.nodes.size() + 1);
  tree_.nodes.push_back(node);
  if (token_.is('{')) {
    open_nodes_.push_back(index_of(tree_.nodes.size() - 1));
  } else if (!token_.is(';')) {
    fail_expecting("';' or '{'");
  }
  advance();
}

void Parser::close_node() {
  if (open_nodes_.empty()) source_.fail(token_.offset, "'}' without its '{'");
  tree_.nodes[open_nodes_.back()].end = index_of(tree_.nodes.size());
  open_nodes_.pop_back();
  advance();
}

Modifiers Parser::modifiers() {
  Modifiers result;
  for (; token_.kind == TokenKind::Symbol; advance()) {
    switch (token_.symbol) {
      case '!':
        result.root = true;
        break;
      case '#':
        result.highlight = true;
        break;
      case '%':
        result.background = true;
        break;
      case '*':
        result.disabled = true;
        break;
      default:
        return result;
    }
  }
  return result;
}

void Parser::argument() {
  Argument result;
  result.value = index_of(tree_.values.size());
  if (token_.kind == TokenKind::Word) {
    const Token word = token_;
    advance();
    if (token_.is('=')) {
      result.name = word.text;
      advance();
      value();
    } else {
      scalar(word);
    }
  } else {
    value();
  }
  tree_.arguments.push_back(result);
}

void Parser::value() {
  do {
    if (token_.is('[')) {
      open_lists_.push_back(index_of(tree_.values.size()));
      tree_.values.push_back({Value::Kind::List, index_of(token_.offset)});
      advance();
      if (!token_.is(']')) continue;
    } else {
      scalar(token_);
      advance();
    }
    while (!open_lists_.empty() && token_.is(']')) {
      tree_.values[open_lists_.back()].end = index_of(tree_.values.size());
      open_lists_.pop_back();
      advance();
    }
    if (!open_lists_.empty()) {
      if (!token_.is(',')) fail_expecting("',' or ']'");
      advance();
    }
  } while (!open_lists_.empty());
}

void Parser::scalar(const Token& token) {
  Value value;
  value.offset = index_of(token.offset);
  value.end = index_of(tree_.values.size() + 1);
  const auto is_word = [&](std::string_view word) { return token.kind == TokenKind::Word && token.text == word; };
  if (token.kind == TokenKind::Number) {
    value.kind = Value::Kind::Number;
    value.number = token.number;
  } else if (token.kind == TokenKind::String) {
    value.kind = Value::Kind::String;
  } else if (is_word("true") || is_word("false")) {
    value.kind = Value::Kind::Boolean;
    value.number = is_word("true") ? 1 : 0;
  } else if (is_word("nan") || is_word("inf")) {
    value.kind = Value::Kind::Number;
    value.number = is_word("nan") ? std::numeric_limits<double>::quiet_NaN() : kInfinity;
  } else if (!is_word("undef")) {
    fail_expecting("a value", token);
  }
  tree_.values.push_back(value);
}

}  // namespace

std::string_view name_of(NodeKind kind) {
  for (const NamedKind& entry : kKinds) {
    if (entry.kind == kind) return entry.name;
  }
  return "unknown";
}

SyntaxTree parse(const Source& source) {
  // Every index below is then less than 2^32, and every halfspace less than 2^30.
  if (source.text.size() > std::size_t{1} << 31) throw ModelError(source.name + ": more than 2 GiB");
  return Parser(source).run();
}

}  // namespace csg
