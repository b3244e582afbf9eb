// An affine map to more digits than a double has, where there is a longer type: a chain of fifty
// transforms then costs the rounding of one.
#pragma once
#include "../vec.hpp"

namespace csg {

class WideAffine {
 public:
  WideAffine() : WideAffine(Affine{}) {}
  explicit WideAffine(const Affine& a) {
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) m_[r][c] = a.linear.col[c][r];
      m_[r][3] = a.offset[r];
    }
  }

  WideAffine operator*(const WideAffine& b) const {
    WideAffine result;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 4; ++c) {
        long double sum = c == 3 ? m_[r][3] : 0;
        for (int k = 0; k < 3; ++k) sum += m_[r][k] * b.m_[k][c];
        result.m_[r][c] = sum;
      }
    return result;
  }

  Affine rounded() const {
    Affine a;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) a.linear.col[c][r] = static_cast<double>(m_[r][c]);
      a.offset[r] = static_cast<double>(m_[r][3]);
    }
    return a;
  }

 private:
  long double m_[3][4];  // rows; the last column is the offset
};

}  // namespace csg
