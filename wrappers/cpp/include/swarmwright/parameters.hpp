// The parameters of an episode, each read with its type, its range and its default.
#pragma once

#include <swarmwright/error.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

namespace swarmwright {

/// x and y.
using Position = std::array<float, 2>;

/// The parameters that an experiment sets for an episode. Missing ones take the default given by the caller.
///
/// All methods throw ParameterError if a value is not valid: it names the parameter, what was found and what is
/// expected.
class Parameters {
 public:
  /// Parameters from a JSON object, for tests of simulations. Throws std::invalid_argument if it is not valid.
  explicit Parameters(const std::string& json) {
    swarmwright_parameters* made = nullptr;
    detail::check(swarmwright_parameters_new(json.c_str(), &made));
    owned_.reset(made);
    given_ = made;
  }

  /// The parameters passed to a function of the C interface, valid during the call.
  explicit Parameters(const swarmwright_parameters* handle) noexcept : given_(handle) {}

  /// All parameters as a JSON object, for values that the other methods cannot read.
  std::string json() const {
    const char* text = swarmwright_parameters_json(given_);
    return text == nullptr ? std::string("{}") : std::string(text);
  }

  /// Whether the experiment sets a parameter.
  bool has(const char* name) const noexcept { return swarmwright_parameter_given(given_, name); }

  /// A whole number in low..high; 13.0 counts as 13.
  template <class Integer = int>
  Integer integer(const char* name, Integer low, Integer high, Integer absent) const {
    static_assert(std::is_integral_v<Integer> && std::numeric_limits<Integer>::digits <= 63, "an integer of 64 bits");
    std::int64_t value = absent;
    detail::check(swarmwright_parameter_integer(given_, name, low, high, &value));
    return static_cast<Integer>(value);
  }

  /// A finite number in low..high; an infinite bound means no limit.
  double number(const char* name, double low, double high, double absent) const {
    detail::check(swarmwright_parameter_number(given_, name, low, high, &absent));
    return absent;
  }

  /// A finite number in low..high, rounded to float before it is compared.
  float single(const char* name, float low, float high, float absent) const {
    detail::check(swarmwright_parameter_single(given_, name, low, high, &absent));
    return absent;
  }

  /// True or false.
  bool flag(const char* name, bool absent) const {
    detail::check(swarmwright_parameter_flag(given_, name, &absent));
    return absent;
  }

  /// The 64 bits of a seed: any whole number from -2^63 to 2^64 - 1.
  std::uint64_t seed(const char* name, std::uint64_t absent = 0) const {
    detail::check(swarmwright_parameter_seed(given_, name, &absent));
    return absent;
  }

  /// A text.
  std::string text(const char* name, const std::string& absent) const {
    const char* text = absent.data();
    std::size_t length = absent.size();
    detail::check(swarmwright_parameter_text(given_, name, &text, &length));
    return {text, length};
  }

  /// One of several texts, as its index; the first of them if absent.
  std::size_t choice(const char* name, std::initializer_list<const char*> choices) const {
    std::size_t index = 0;
    detail::check(swarmwright_parameter_choice(given_, name, choices.begin(), choices.size(), &index));
    return index;
  }

  /// A list of least..most finite numbers, each in low..high.
  std::optional<std::vector<double>> numbers(const char* name, std::size_t least, std::size_t most,
                                             double low = -std::numeric_limits<double>::infinity(),
                                             double high = std::numeric_limits<double>::infinity()) const {
    const double* values = nullptr;
    std::size_t count = 0;
    detail::check(swarmwright_parameter_numbers(given_, name, least, most, low, high, &values, &count));
    if (values == nullptr) {
      return std::nullopt;
    }
    return std::vector<double>(values, values + count);
  }

  /// A position [x, y] in 0..width and 0..height, borders included, rounded to float.
  std::optional<Position> position(const char* name, float width, float height) const {
    if (!has(name)) {
      return std::nullopt;
    }
    Position position{};
    detail::check(swarmwright_parameter_position(given_, name, width, height, position.data()));
    return position;
  }

  /// At most `most` positions [[x, y], ..], as position().
  std::optional<std::vector<Position>> positions(const char* name, std::uint32_t most, float width,
                                                 float height) const {
    const float* values = nullptr;
    std::size_t count = 0;
    detail::check(swarmwright_parameter_positions(given_, name, most, width, height, &values, &count));
    if (values == nullptr) {
      return std::nullopt;
    }
    std::vector<Position> found(count);
    for (std::size_t i = 0; i < count; ++i) {
      found[i] = {values[2 * i], values[2 * i + 1]};
    }
    return found;
  }

 private:
  struct Free {
    void operator()(swarmwright_parameters* handle) const noexcept { swarmwright_parameters_free(handle); }
  };
  std::unique_ptr<swarmwright_parameters, Free> owned_;
  const swarmwright_parameters* given_ = nullptr;
};

}  // namespace swarmwright
