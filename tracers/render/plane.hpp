// The memory of a picture, which is larger than caches: making it ready cost a part of the time to draw it.
#pragma once
#include <vector>

#include "../large_pages.hpp"

namespace csg {

/// Values of height × width pixels, row by row from the top. Not cleared, as every pixel is drawn, so that a page is
/// first touched by the thread that draws there.
template <class T>
using Plane = std::vector<T, LargePages<T>>;

}  // namespace csg
