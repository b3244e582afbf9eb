// The syntax tree → CsgTree, by the rules of OpenSCAD 2021.01, each checked against its renderings:
//
// - group, multmatrix, color, render and the whole file are unions of their children.
// - An empty first child empties a difference; any empty child empties an intersection. A child
//   under % or * is no child at all.
// - ! makes its subtree the whole model, without the transforms around it; the first one counts.
// - The outermost color whose components are all ≥ 0 wins. (OpenSCAD forgets the colors inside a
//   render(); here they pass through.)
#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <system_error>
#include <utility>

#include "arguments.hpp"
#include "invert.hpp"
#include "leaf_reader.hpp"
#include "lexer.hpp"
#include "loader.hpp"
#include "nary.hpp"
#include "parser.hpp"
#include "tally.hpp"
#include "wide_affine.hpp"

namespace csg {
namespace {

class Lowering {
 public:
  Lowering(const Source& source, const SyntaxTree& tree)
      : source_(source), tree_(tree), reader_(source, tree, warnings_) {}
  CsgTree run(Shape shape);

 private:
  /// What the multmatrix and color nodes around a leaf do to it.
  struct Placement {
    WideAffine world_from_local;
    bool has_color = false;
    float color[3] = {0, 0, 0};
  };
  /// An operator whose children are being read.
  struct Frame {
    Op op;
    bool has_placement = false;  ///< its own, to be taken off when it closes
    bool is_void = false;        ///< empty whatever its further children are
    std::uint32_t end;           ///< of its syntax node
    std::uint32_t item, first_leaf;
    std::uint32_t operands = 0;  ///< children that are not empty
  };
  struct Range {
    std::uint32_t begin, end;
  };

  Range find_root();
  void open(Op op, std::uint32_t end);
  void close();
  std::uint32_t visit(std::uint32_t index);
  void add_leaf(const LeafReading& reading);
  void add_child(bool empty);
  void push_transform(const SyntaxNode& node);
  void push_color(const SyntaxNode& node);
  [[noreturn]] void refuse_unsupported() const;
  [[noreturn]] void refuse_empty() const;
  std::vector<std::string> warning_lines() const;

  const Source& source_;
  const SyntaxTree& tree_;
  Tally warnings_, unsupported_;
  LeafReader reader_;
  std::vector<Frame> frames_;
  std::vector<Placement> placements_{1};
  std::vector<NaryItem> items_;
  std::vector<Leaf> leaves_;
};

CsgTree Lowering::run(Shape shape) {
  leaves_.reserve(static_cast<std::size_t>(
      std::ranges::count_if(tree_.nodes, [](const SyntaxNode& node) { return LeafReader::reads(node.kind); })));
  const Range root = find_root();
  open(Op::Union, root.end);
  for (std::uint32_t i = root.begin; i < root.end;) {
    const SyntaxNode& node = tree_.nodes[i];
    // The node under ! is the model even where % stands beside it.
    const bool is_root = i == root.begin && node.modifiers.root && !node.modifiers.disabled;
    i = node.modifiers.left_out() && !is_root ? node.end : visit(i);
    while (frames_.size() > 1 && frames_.back().end == i) close();
  }
  close();
  if (!unsupported_.entries().empty()) refuse_unsupported();
  if (leaves_.empty()) refuse_empty();
  try {
    return CsgTree(std::move(leaves_), to_binary(items_, shape), warning_lines());
  } catch (const ModelError& error) {
    throw ModelError(source_.name + ": " + error.what());
  }
}

Lowering::Range Lowering::find_root() {
  const auto end = static_cast<std::uint32_t>(tree_.nodes.size());
  Range root{0, end};
  bool found = false;
  for (std::uint32_t i = 0; i < end;) {
    const SyntaxNode& node = tree_.nodes[i];
    if (node.modifiers.disabled) {
      i = node.end;
      continue;
    }
    if (node.modifiers.root && !found) {
      found = true;
      root = {i, node.end};
    } else if (node.modifiers.root) {
      warnings_.add("more than one '!': the first is the model", node.offset);
    }
    ++i;
  }
  return root;
}

void Lowering::open(Op op, std::uint32_t end) {
  frames_.push_back({.op = op,
                     .end = end,
                     .item = static_cast<std::uint32_t>(items_.size()),
                     .first_leaf = static_cast<std::uint32_t>(leaves_.size())});
  items_.push_back({op});
}

void Lowering::close() {
  const Frame frame = frames_.back();
  frames_.pop_back();
  if (frame.has_placement) placements_.pop_back();
  const bool empty = frame.is_void || frame.operands == 0;
  if (empty) {
    items_.resize(frame.item);
    leaves_.resize(frame.first_leaf);
  } else {
    items_[frame.item].end = static_cast<std::uint32_t>(items_.size());
  }
  if (!frames_.empty()) add_child(empty);
}

void Lowering::add_child(bool empty) {
  Frame& parent = frames_.back();
  if (!empty) {
    ++parent.operands;
  } else if (parent.op == Op::Intersection || (parent.op == Op::Difference && parent.operands == 0)) {
    parent.is_void = true;
  }
}

/// Returns the index of the node to read next.
std::uint32_t Lowering::visit(std::uint32_t index) {
  const SyntaxNode& node = tree_.nodes[index];
  if (LeafReader::reads(node.kind)) {
    const LeafReading reading = reader_.read(index);
    if (reading.outcome != LeafReading::Outcome::Unsupported) {
      add_leaf(reading);
      return node.end;
    }
    unsupported_.add(reading.fault, node.offset);
  }
  Op op = Op::Union;
  if (node.kind == NodeKind::Difference) op = Op::Difference;
  if (node.kind == NodeKind::Intersection) op = Op::Intersection;
  open(op, node.end);
  switch (node.kind) {
    case NodeKind::Multmatrix:
      push_transform(node);
      break;
    case NodeKind::Color:
      push_color(node);
      break;
    case NodeKind::Render:
      Arguments(source_, tree_, node, {"convexity"});
      break;
    case NodeKind::Group:
    case NodeKind::Union:
    case NodeKind::Difference:
    case NodeKind::Intersection:
      Arguments(source_, tree_, node, {});
      break;
    case NodeKind::RotateExtrude:
      break;  // counted above
    case NodeKind::Circle:
    case NodeKind::Square:
    case NodeKind::Polygon:
    case NodeKind::Text:
      unsupported_.add("2D " + std::string(name_of(node.kind)), node.offset);
      break;
    default:
      unsupported_.add(name_of(node.kind), node.offset);
  }
  return index + 1;  // also below an unsupported node, to name all that is
}

void Lowering::add_leaf(const LeafReading& reading) {
  const bool empty = reading.outcome == LeafReading::Outcome::Empty;
  if (!empty) {
    const Placement& placement = placements_.back();
    Leaf leaf = reading.leaf;
    const WideAffine to_center(Affine{{}, reading.center});
    leaf.world_from_local = (placement.world_from_local * to_center).rounded();
    leaf.has_color = placement.has_color;
    std::ranges::copy(placement.color, leaf.color);
    const auto index = static_cast<std::uint32_t>(leaves_.size());
    items_.push_back({Op::Leaf, index, static_cast<std::uint32_t>(items_.size() + 1)});
    leaves_.push_back(leaf);
  }
  add_child(empty);
}

void Lowering::push_transform(const SyntaxNode& node) {
  const Affine local = Arguments(source_, tree_, node, {""}).matrix();
  Placement placement = placements_.back();
  placement.world_from_local = placement.world_from_local * WideAffine(local);
  const auto [linear, offset] = placement.world_from_local.rounded();
  const bool finite = std::isfinite(offset.x) && std::isfinite(offset.y) && std::isfinite(offset.z);
  if (!finite || !invert(linear).usable()) {
    source_.fail(node.offset, invert(local.linear).usable() ? "multmatrix: singular or not finite with those around it"
                                                            : "multmatrix: a singular matrix");
  }
  placements_.push_back(placement);
  frames_.back().has_placement = true;
}

void Lowering::push_color(const SyntaxNode& node) {
  double rgba[4];
  Arguments(source_, tree_, node, {""}).vector("", rgba);
  const bool valid = std::ranges::all_of(rgba, [](double value) { return value >= 0; });
  if (placements_.back().has_color || !valid) return;
  Placement placement = placements_.back();
  placement.has_color = true;
  for (int i = 0; i < 3; ++i) placement.color[i] = static_cast<float>(std::min(rgba[i], 1.0));
  placements_.push_back(placement);
  frames_.back().has_placement = true;
}

void Lowering::refuse_unsupported() const {
  const auto& entries = unsupported_.entries();
  std::string line = source_.at(entries[0].first_offset) + ": unsupported: ";
  for (const Tally::Entry& entry : entries) {
    const bool is_first = &entry == entries.data();  // its place stands in front
    std::string where = entry.count > 1 ? "the first of " + std::to_string(entry.count) : "";
    if (!is_first) where += (where.empty() ? "at " : " at ") + source_.at(entry.first_offset);
    line += (is_first ? "" : ", ") + entry.remark + (where.empty() ? "" : " (" + where + ")");
  }
  throw ModelError(line);
}

/// With the warnings, for one may say why: a sphere of radius 0.
void Lowering::refuse_empty() const {
  std::string line = source_.name + ": the model is empty";
  for (const std::string& warning : warning_lines()) line += "; " + warning;
  throw ModelError(line);
}

std::vector<std::string> Lowering::warning_lines() const {
  std::vector<std::string> lines;
  for (const Tally::Entry& entry : warnings_.entries()) {
    lines.push_back(source_.at(entry.first_offset) + ": " + entry.remark);
    if (entry.count > 1) lines.back() += " (the first of " + std::to_string(entry.count) + ")";
  }
  return lines;
}

std::string contents_of(const std::string& path) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), &std::fclose);
  const auto fail = [&path] { throw ModelError(path + ": cannot be read: " + std::generic_category().message(errno)); };
  if (!file) fail();
  constexpr std::size_t kChunk = std::size_t{1} << 22;
  std::string text;
  std::error_code no_size;  // a pipe has none
  if (const auto size = std::filesystem::file_size(path, no_size); !no_size) text.reserve(size + kChunk);
  for (std::size_t got = 1; got > 0;) {
    const std::size_t before = text.size();
    text.resize(before + kChunk);
    got = std::fread(text.data() + before, 1, kChunk, file.get());
    text.resize(before + got);
  }
  if (std::ferror(file.get())) fail();
  return text;
}

}  // namespace

CsgTree parse_csg(std::string_view text, const std::string& name, Shape shape) {
  const Source source{text, name};
  const SyntaxTree tree = parse(source);
  return Lowering(source, tree).run(shape);
}

CsgTree load_csg(const std::string& path, Shape shape, const std::string& name) {
  return parse_csg(contents_of(path), name.empty() ? path : name, shape);
}

}  // namespace csg
