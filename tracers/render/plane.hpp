// The memory of a picture, which is larger than caches.
#pragma once
#include <vector>

#include "../large_pages.hpp"

namespace csg {

/// Values of height × width pixels, row by row from the top.
template <class T>
using Plane = std::vector<T, LargePages<T>>;

}  // namespace csg
