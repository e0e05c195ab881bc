// Errors as exceptions, and exceptions as statuses and texts for the C interface.
#pragma once

#include <swarmwright/swarmwright.h>

#include <cstdlib>
#include <exception>
#include <memory>
#include <stdexcept>
#include <string>
#include <typeinfo>
#include <utility>

#if __has_include(<cxxabi.h>)
#include <cxxabi.h>
#define SWARMWRIGHT_DEMANGLES 1
#endif

namespace swarmwright {

/// An operation has failed: the broker does not answer or refuses access, or the server's id is taken.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A parameter of an episode cannot be used. A simulation may throw it from reset; Parameters does.
class ParameterError : public std::runtime_error {
 public:
  /// `reason`: what was found, and what is expected.
  ParameterError(std::string name, std::string reason)
      : std::runtime_error("parameter " + name + ": " + reason), name_(std::move(name)), reason_(std::move(reason)) {}

  const std::string& name() const noexcept { return name_; }
  const std::string& reason() const noexcept { return reason_; }

 private:
  std::string name_;
  std::string reason_;
};

namespace detail {

/// Throws the error of a call of the C interface: ParameterError, std::invalid_argument or Error.
inline void check(swarmwright_status status) {
  if (status == SWARMWRIGHT_OK) {
    return;
  }
  if (const char* parameter = swarmwright_error_parameter()) {
    throw ParameterError(parameter, swarmwright_error_reason());
  }
  if (status == SWARMWRIGHT_INVALID) {
    throw std::invalid_argument(swarmwright_error());
  }
  throw Error(swarmwright_error());
}

/// A type's name as in source code.
inline std::string readable(const char* name) {
#ifdef SWARMWRIGHT_DEMANGLES
  struct Free {
    void operator()(char* text) const noexcept { std::free(text); }
  };
  int status = 0;
  const std::unique_ptr<char, Free> text(abi::__cxa_demangle(name, nullptr, nullptr, &status));
  if (status == 0 && text) {
    return text.get();
  }
#endif
  return name;
}

/// The type and text of the exception that is being handled, and of the exceptions nested in it.
inline std::string words_of_current_exception() {
  try {
    throw;
  } catch (const std::exception& error) {
    std::string words = readable(typeid(error).name()) + ": " + error.what();
    // The wrapper type of std::throw_with_nested is left out.
    const std::string wrapper = "std::_Nested_exception<";
    if (words.compare(0, wrapper.size(), wrapper) == 0) {
      words = error.what();
    }
    try {
      std::rethrow_if_nested(error);
    } catch (...) {
      words += "\n  because of " + words_of_current_exception();
    }
    return words;
  } catch (const std::string& text) {
    return text;
  } catch (const char* text) {
    return text;
  } catch (...) {
#ifdef SWARMWRIGHT_DEMANGLES
    if (const std::type_info* type = abi::__cxa_current_exception_type()) {
      return "an exception of type " + readable(type->name());
    }
#endif
    return "an exception of an unknown type";
  }
}

/// Makes a call; an exception becomes a status and a text for the C interface.
template <class Call>
swarmwright_status guarded(Call&& call) noexcept {
  try {
    std::forward<Call>(call)();
    return SWARMWRIGHT_OK;
  } catch (const ParameterError& error) {
    swarmwright_set_parameter_error(error.name().c_str(), error.reason().c_str());
    return SWARMWRIGHT_INVALID;
  } catch (...) {
    try {
      swarmwright_set_error(words_of_current_exception().c_str());
    } catch (...) {
      swarmwright_set_error("an exception, and not enough memory to describe it");
    }
    return SWARMWRIGHT_FAILED;
  }
}

}  // namespace detail
}  // namespace swarmwright
