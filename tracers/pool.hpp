// Working memory that is dear to make anew for every batch of rays, shared by the threads that trace.
#pragma once
#include <memory>
#include <mutex>
#include <vector>

namespace csg {

/// Holds what nobody uses: never more items than threads have used at once.
template <class Item>
class Pool {
 public:
  /// An idle item, or what `make()` returns, a pointer that owns a new one.
  template <class Make>
  std::unique_ptr<Item> take(Make make) {
    {
      const std::lock_guard lock(mutex_);
      if (!idle_.empty()) {
        std::unique_ptr<Item> item = std::move(idle_.back());
        idle_.pop_back();
        return item;
      }
    }
    return make();
  }

  /// An item whose use ended in an exception is not given back: what it holds may be half done.
  void give_back(std::unique_ptr<Item> item) {
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(item));
  }

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<Item>> idle_;
};

}  // namespace csg
