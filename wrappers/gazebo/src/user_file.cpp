#include "user_file.hpp"

#include "gazebo.hpp"

#include <tinyxml2.h>

#include <sdf/parser.hh>

#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <sstream>
#include <string_view>

namespace swarmwright::gazebo {

namespace {

using tinyxml2::XMLElement;

/// Models that include each other would have no end.
constexpr int deepest_include = 16;

[[noreturn]] void refuse(const std::string& path, int line, const std::string& what) {
  throw GazeboError(path + ":" + std::to_string(line) + ": " + what);
}

std::string contents(const std::string& path) {
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) {
    throw GazeboError(path + ": a folder found, expected a file in SDF");
  }
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    throw GazeboError(path + ": no such file, or it cannot be read");
  }
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

/// What is written to std::cerr while this object exists. The library of SDF tells most mistakes there only.
class Captured {
 public:
  Captured() : before_(std::cerr.rdbuf(text_.rdbuf())) {}
  ~Captured() { std::cerr.rdbuf(before_); }
  Captured(const Captured&) = delete;
  Captured& operator=(const Captured&) = delete;

  /// Its lines, errors first, without colours and places in the library's source code.
  std::vector<std::string> lines() const {
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

 private:
  std::ostringstream text_;
  std::streambuf* before_;
};

/// A file in XML, and those that it includes.
class Checked {
 public:
  Checked(const std::string& path, const Find& find, int depth = 0) : path_(path), find_(find), depth_(depth) {
    const std::string text = contents(path);
    if (document_.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS || document_.RootElement() == nullptr) {
      std::string problem = document_.ErrorName();
      problem = problem.compare(0, 4, "XML_") == 0 ? problem.substr(4) : problem;
      refuse(path_, std::max(1, document_.ErrorLineNum()),
             "not valid XML (" + problem + "); `xmllint --noout` tells more");
    }
    const XMLElement& root = this->root();
    if (std::string_view(root.Name()) != "sdf") {
      refuse(path_, root.GetLineNum(), "<" + std::string(root.Name()) + "> found, expected <sdf>: the file is not SDF");
    }
    if (root.Attribute("version") == nullptr) {
      refuse(path_, root.GetLineNum(), "<sdf> without its version, such as version=\"1.6\"");
    }
    check(root);
  }

  const XMLElement& root() const { return *document_.RootElement(); }
  bool repeatable() const { return repeatable_; }

 private:
  void check(const XMLElement& element) {
    const std::string_view name = element.Name();
    if (name == "include") {
      check_include(element);
    } else if (name == "mesh") {
      const XMLElement* uri = element.FirstChildElement("uri");
      if (uri != nullptr) {
        found(*uri);
      }
    } else if (name == "physics") {
      check_engine(element);
    } else if (name == "plugin" || name == "actor") {
      repeatable_ = false;
    }
    for (const XMLElement* child = element.FirstChildElement(); child != nullptr; child = child->NextSiblingElement()) {
      check(*child);
    }
  }

  void check_engine(const XMLElement& physics) const {
    const char* type = physics.Attribute("type");
    if (type != nullptr && std::string_view(type) != "ode") {
      refuse(path_, physics.GetLineNum(),
             "<physics type=\"" + std::string(type) + "\">: expected ode, the only engine here");
    }
  }

  void check_include(const XMLElement& include) {
    const XMLElement* uri = include.FirstChildElement("uri");
    if (uri == nullptr) {
      refuse(path_, include.GetLineNum(), "<include> without <uri>");
    }
    std::string file = found(*uri);
    if (std::filesystem::is_directory(file)) {
      const Captured captured;
      file = sdf::getModelFilePath(file);
      if (file.empty()) {
        refuse(path_, uri->GetLineNum(),
               "<include> of \"" + text_of(*uri) + "\": its folder has no model.config, or that names no file");
      }
    }
    if (depth_ == deepest_include) {
      refuse(path_, uri->GetLineNum(),
             "<include> of \"" + text_of(*uri) + "\": models include each other without an end");
    }
    repeatable_ &= Checked(file, find_, depth_ + 1).repeatable();
  }

  static std::string text_of(const XMLElement& element) {
    std::string text = element.GetText() == nullptr ? "" : element.GetText();
    const std::size_t first = text.find_first_not_of(" \t\r\n");
    const std::size_t last = text.find_last_not_of(" \t\r\n");
    return first == std::string::npos ? "" : text.substr(first, last - first + 1);
  }

  /// Where the resource is that an <uri> names.
  std::string found(const XMLElement& uri) const {
    const std::string name = text_of(uri);
    std::string where = find_(name);
    if (where.empty()) {
      const bool network = name.compare(0, 7, "http://") == 0 || name.compare(0, 8, "https://") == 0;
      refuse(path_, uri.GetLineNum(),
             "<" + std::string(uri.Parent()->ToElement()->Name()) + "> of \"" + name + "\": not found; " +
                 (network ? "nothing is fetched from the network: save it beside the file, and name it model://NAME"
                          : "put it beside the file, or its folder's parent into GAZEBO_MODEL_PATH"));
    }
    return where;
  }

  std::string path_;
  const Find& find_;
  int depth_;
  bool repeatable_ = true;
  tinyxml2::XMLDocument document_;
};

/// What the library has to say, as one line: what it was that could not be read, and in which element.
std::string joined(const sdf::Errors& errors, const std::vector<std::string>& lines) {
  std::string all;
  for (const std::string& line : lines) {
    // What is not SDF is tried as URDF, too.
    if (line.find("urdf") == std::string::npos) {
      all += line + "; ";
    }
  }
  return all + (errors.empty() ? "Gazebo cannot read it" : errors.front().Message());
}

}  // namespace

UserWorld read_world(const std::string& path, const Find& find) {
  const Checked checked(path, find);
  const XMLElement* first = checked.root().FirstChildElement("world");
  if (first == nullptr) {
    refuse(path, checked.root().GetLineNum(), "<sdf> without <world>: expected a world, in which robots are put");
  }
  if (const XMLElement* second = first->NextSiblingElement("world")) {
    refuse(path, second->GetLineNum(), "a second <world> found, expected one");
  }
  UserWorld world;
  world.path = path;
  world.repeatable = checked.repeatable();
  const sdf::SDFPtr parsed(new sdf::SDF);
  sdf::Errors errors;
  const Captured captured;
  const bool read = sdf::init(parsed) && sdf::readFile(path, parsed, errors);
  world.warnings = captured.lines();
  if (!read || !errors.empty() || !parsed->Root()->HasElement("world")) {
    throw GazeboError(path + ": " + joined(errors, world.warnings));
  }
  world.world = parsed->Root()->GetElement("world");
  return world;
}

sdf::ElementPtr parsed_world(const std::string& text) {
  const sdf::SDFPtr parsed(new sdf::SDF);
  if (!sdf::init(parsed) || !sdf::readString(text, parsed)) {
    throw GazeboError("Gazebo cannot read the world of the mission");
  }
  return parsed->Root()->GetElement("world");
}

}  // namespace swarmwright::gazebo
