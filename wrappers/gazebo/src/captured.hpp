// What a library writes to std::cerr.
#pragma once

#include <sstream>
#include <string>
#include <vector>

namespace swarmwright::gazebo {

/// Keeps what this thread writes to std::cerr while this object exists; other threads write as before. The library of
/// SDF tells most mistakes there only. Objects of a thread are destroyed in the opposite order of their construction.
class Captured {
 public:
  Captured();
  ~Captured();
  Captured(const Captured&) = delete;
  Captured& operator=(const Captured&) = delete;

  /// Its lines, errors first, without colours and places in the library's source code.
  std::vector<std::string> lines() const;

 private:
  std::stringbuf text_;
  std::streambuf* before_;
};

}  // namespace swarmwright::gazebo
