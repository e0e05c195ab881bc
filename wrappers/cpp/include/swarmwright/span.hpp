// A view of an array of numbers.
#pragma once

#include <cassert>
#include <cstddef>
#include <iterator>
#include <type_traits>
#include <utility>

namespace swarmwright {

/// The part of std::span of C++20 that is needed here. Made from vectors, arrays and anything with data() and size().
template <class T>
class Span {
 public:
  constexpr Span() noexcept = default;
  constexpr Span(T* data, std::size_t size) noexcept : data_(data), size_(size) {}

  template <class Range, class Pointer = decltype(std::data(std::declval<Range&>())),
            class = std::enable_if_t<std::is_convertible_v<std::remove_pointer_t<Pointer> (*)[], T (*)[]>>>
  constexpr Span(Range&& range) noexcept : data_(std::data(range)), size_(std::size(range)) {}

  constexpr T* data() const noexcept { return data_; }
  constexpr std::size_t size() const noexcept { return size_; }
  constexpr bool empty() const noexcept { return size_ == 0; }
  constexpr T* begin() const noexcept { return data_; }
  constexpr T* end() const noexcept { return size_ == 0 ? data_ : data_ + size_; }

  constexpr T& operator[](std::size_t index) const {
    assert(index < size_);
    return data_[index];
  }

  /// `count` items from `first` on.
  constexpr Span subspan(std::size_t first, std::size_t count) const {
    assert(first <= size_ && count <= size_ - first);
    return {data_ + first, count};
  }

 private:
  T* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace swarmwright
