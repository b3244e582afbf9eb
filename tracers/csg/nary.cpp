#include "nary.hpp"

#include <utility>

namespace csg {
namespace {

class Binarizer {
 public:
  Binarizer(const std::vector<NaryItem>& items, Shape shape) : items_(items), shape_(shape) {}
  std::vector<Node> run();

 private:
  /// Either "write operands [begin, end) joined by op" or, if begin == end, "write op itself, over
  /// the two subtrees written last".
  struct Task {
    Op op;
    std::uint32_t begin, end;
  };

  void write_item(std::uint32_t index);
  void write_operator(Op op);
  void split(const Task& task);

  const std::vector<NaryItem>& items_;
  const Shape shape_;
  std::vector<std::uint32_t> operands_;  // item indices, of all operators met so far
  std::vector<Task> tasks_;              // the next one last
  std::vector<std::int32_t> roots_;      // subtrees written that still wait for their parent
  std::vector<Node> nodes_;
};

std::vector<Node> Binarizer::run() {
  write_item(0);
  while (!tasks_.empty()) {
    const Task task = tasks_.back();
    tasks_.pop_back();
    if (task.begin == task.end) {
      write_operator(task.op);
    } else if (task.end - task.begin == 1) {
      write_item(operands_[task.begin]);
    } else {
      split(task);
    }
  }
  return std::move(nodes_);
}

void Binarizer::write_item(std::uint32_t index) {
  const NaryItem& item = items_[index];
  if (item.op == Op::Leaf) {
    roots_.push_back(static_cast<std::int32_t>(nodes_.size()));
    nodes_.push_back({Op::Leaf, static_cast<std::int32_t>(item.leaf), -1});
    return;
  }
  const auto begin = static_cast<std::uint32_t>(operands_.size());
  for (std::uint32_t i = index + 1; i < item.end; i = items_[i].end) operands_.push_back(i);
  tasks_.push_back({item.op, begin, static_cast<std::uint32_t>(operands_.size())});
}

void Binarizer::write_operator(Op op) {
  const std::int32_t right = roots_.back();
  roots_.pop_back();
  const std::int32_t left = std::exchange(roots_.back(), static_cast<std::int32_t>(nodes_.size()));
  nodes_.push_back({op, left, right});
}

void Binarizer::split(const Task& task) {
  const auto [op, begin, end] = task;
  std::uint32_t middle = end - 1;  // left-deep
  Op right_op = op;
  if (shape_ == Shape::Balanced) {
    middle = begin + (end - begin + 1) / 2;
    if (op == Op::Difference) {  // a − b − c − d = a − (b ∪ c ∪ d)
      middle = begin + 1;
      right_op = Op::Union;
    }
  }
  tasks_.push_back({op, 0, 0});
  tasks_.push_back({right_op, middle, end});
  tasks_.push_back({op, begin, middle});
}

}  // namespace

std::vector<Node> to_binary(const std::vector<NaryItem>& items, Shape shape) { return Binarizer(items, shape).run(); }

}  // namespace csg
