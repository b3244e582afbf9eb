// Memory for what is larger than caches: in small pages, finding a page costs as much as what is read there.
#pragma once
#include <sys/mman.h>

#include <cstddef>
#include <new>

namespace csg {

/// An allocator of large pages, where the system has them.
template <class T>
struct LargePages {
  using value_type = T;

  LargePages() = default;
  template <class Other>
  LargePages(const LargePages<Other>&) {}

  T* allocate(std::size_t count) {
    void* memory = ::operator new(count * sizeof(T), kLargePage);
    madvise(memory, count * sizeof(T), MADV_HUGEPAGE);  // a wish; nothing depends on it
    return static_cast<T*>(memory);
  }
  void deallocate(T* memory, std::size_t) { ::operator delete(memory, kLargePage); }
  bool operator==(const LargePages&) const = default;

 private:
  static constexpr std::align_val_t kLargePage{std::size_t{1} << 21};
};

}  // namespace csg
