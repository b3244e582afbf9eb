// Counts remarks about a source, so that a thousand equal ones make one line.
#pragma once
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace csg {

class Tally {
 public:
  struct Entry {
    std::string remark;
    std::size_t count = 0;
    std::size_t first_offset = 0;
  };

  void add(std::string_view remark, std::size_t offset) {
    for (Entry& entry : entries_) {
      if (entry.remark == remark) {
        ++entry.count;
        return;
      }
    }
    entries_.push_back({std::string(remark), 1, offset});
  }
  const std::vector<Entry>& entries() const { return entries_; }  ///< in the order of first sight

 private:
  std::vector<Entry> entries_;
};

}  // namespace csg
