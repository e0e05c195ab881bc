// A small test framework: failed checks are printed with file and line, and the program fails.
#pragma once

#include <exception>
#include <functional>
#include <iostream>
#include <sstream>
#include <string>

namespace check {

inline int failures = 0;

template <class A, class B>
void equal(const A& actual, const B& expected, const char* file, int line) {
  if (!(actual == expected)) {
    ++failures;
    std::cerr << file << ':' << line << ": found     " << actual << "\n    expected  " << expected << std::endl;
  }
}

/// The text of the E that `call` throws, or what it does instead.
template <class E>
std::string thrown(const std::function<void()>& call) {
  try {
    call();
  } catch (const E& error) {
    return error.what();
  } catch (const std::exception& error) {
    return std::string("(another exception) ") + error.what();
  }
  return "(nothing)";
}

inline int status() {
  std::cerr << (failures == 0 ? "ok" : std::to_string(failures) + " failures") << std::endl;
  return failures == 0 ? 0 : 1;
}

}  // namespace check

#define CHECK_EQUAL(found, expected) check::equal((found), (expected), __FILE__, __LINE__)
#define CHECK_THROWS(type, text, ...) CHECK_EQUAL(check::thrown<type>([&] { __VA_ARGS__; }), std::string(text))
