#include "captured.hpp"

#include <iostream>

namespace swarmwright::gazebo {

namespace {

/// Where the text of this thread goes; nullptr: to where std::cerr wrote at first.
thread_local std::streambuf* target = nullptr;

/// The buffer of std::cerr once there was a capture: it passes each thread's text on.
class Switch : public std::streambuf {
 public:
  explicit Switch(std::streambuf* usual) : usual_(usual) {}

 protected:
  int_type overflow(int_type letter) override {
    return traits_type::eq_int_type(letter, traits_type::eof()) ? traits_type::not_eof(letter)
                                                                : current()->sputc(traits_type::to_char_type(letter));
  }
  std::streamsize xsputn(const char* text, std::streamsize size) override { return current()->sputn(text, size); }
  int sync() override { return current()->pubsync(); }

 private:
  std::streambuf* current() const { return target == nullptr ? usual_ : target; }

  std::streambuf* usual_;
};

}  // namespace

Captured::Captured() : before_(target) {
  // Never destroyed: std::cerr is used until the process ends.
  static auto& shared = *new Switch(std::cerr.rdbuf());
  if (std::cerr.rdbuf() != &shared) {
    std::cerr.rdbuf(&shared);
  }
  target = &text_;
}

Captured::~Captured() { target = before_; }

std::vector<std::string> Captured::lines() const {
  std::vector<std::string> errors;
  std::vector<std::string> others;
  std::istringstream text(text_.str());
  for (std::string line; std::getline(text, line);) {
    for (std::size_t start = line.find('\033'); start != std::string::npos; start = line.find('\033')) {
      const std::size_t end = line.find('m', start);
      line.erase(start, end == std::string::npos ? end : end - start + 1);
    }
    const bool error = line.compare(0, 7, "Error [") == 0;
    const std::size_t end = error || line.compare(0, 9, "Warning [") == 0 ? line.find(']') : std::string::npos;
    line.erase(0, end == std::string::npos ? 0 : line.find_first_not_of(' ', end + 1));
    if (!line.empty()) {
      (error ? errors : others).push_back(line);
    }
  }
  errors.insert(errors.end(), others.begin(), others.end());
  return errors;
}

}  // namespace swarmwright::gazebo
