// The memory of a picture, which is larger than caches: making it ready cost a part of the time to draw it.
#pragma once
#include <sys/mman.h>

#include <cstddef>
#include <new>
#include <vector>

namespace csg {

/// Not cleared, as every pixel is drawn, so that a page is first touched by the thread that draws there. In large
/// pages, where the system has them.
template <class T>
struct PlaneMemory {
  using value_type = T;

  T* allocate(std::size_t count) {
    void* memory = ::operator new(count * sizeof(T), kLargePage);
    madvise(memory, count * sizeof(T), MADV_HUGEPAGE);  // a wish; nothing depends on it
    return static_cast<T*>(memory);
  }
  void deallocate(T* memory, std::size_t) { ::operator delete(memory, kLargePage); }
  void construct(T*) {}
  bool operator==(const PlaneMemory&) const = default;

 private:
  static constexpr std::align_val_t kLargePage{std::size_t{1} << 21};
};

/// Values of height × width pixels, row by row from the top.
template <class T>
using Plane = std::vector<T, PlaneMemory<T>>;

}  // namespace csg
