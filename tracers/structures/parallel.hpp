// A loop by several threads.
#pragma once
#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <thread>
#include <vector>

#include "../params.hpp"

namespace csg {

/// The declaration of how many threads build, for schemes where several can.
inline ParamSpec build_threads_param() {
  return {.name = "build_threads",
          .meaning = "that build, to the same answers whatever their number; 0: one a core",
          .default_value = 1L,
          .minimum = 0,
          .maximum = 256,
          .trial_values = {2L},
          .implied_by_default = true};
}

/// 0 means one a core.
inline std::size_t thread_count(int asked) {
  return asked > 0 ? static_cast<std::size_t>(asked) : std::max(1u, std::thread::hardware_concurrency());
}

/// Calls `one(i, thread)` for each i below `count`, in any order; `thread` is below `threads`. What one
/// call throws is thrown on.
template <class One>
void in_parallel(std::size_t threads, std::size_t count, One one) {
  std::atomic<std::size_t> next = 0;
  std::vector<std::exception_ptr> failed(threads);
  const auto work = [&](std::size_t thread) {
    try {
      for (std::size_t i; (i = next++) < count;) one(i, thread);
    } catch (...) {
      failed[thread] = std::current_exception();
    }
  };
  {
    std::vector<std::jthread> others;
    for (std::size_t thread = 1; thread < std::min(threads, count); ++thread) others.emplace_back(work, thread);
    work(0);
  }
  for (const std::exception_ptr& failure : failed)
    if (failure) std::rethrow_exception(failure);
}

}  // namespace csg
