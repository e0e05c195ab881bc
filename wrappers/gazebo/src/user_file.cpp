#include "user_file.hpp"

#include "captured.hpp"
#include "library.hpp"

#include <tinyxml2.h>

#include <sdf/parser.hh>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string_view>

namespace swarmwright::gazebo {

namespace {

using tinyxml2::XMLElement;

/// Models that include each other would have no end.
constexpr int deepest_include = 16;

[[noreturn]] void refuse(const std::string& path, int line, const std::string& problem) {
  throw GazeboError(path + ":" + std::to_string(line) + ": " + problem);
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

/// A file in XML, and those that it includes.
class Checked {
 public:
  /// `urdf`: whether it may be URDF, too.
  Checked(const std::string& path, const std::string& text, const Find& find, int depth = 0, bool urdf = false)
      : path_(path), find_(find), depth_(depth) {
    if (document_.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS || document_.RootElement() == nullptr) {
      std::string problem = document_.ErrorName();
      problem = problem.compare(0, 4, "XML_") == 0 ? problem.substr(4) : problem;
      refuse(path_, std::max(1, document_.ErrorLineNum()),
             "not valid XML (" + problem + "); `xmllint --noout` tells more");
    }
    const XMLElement& root = this->root();
    is_urdf_ = urdf && std::string_view(root.Name()) == "robot";
    if (!is_urdf_ && std::string_view(root.Name()) != "sdf") {
      refuse(path_, root.GetLineNum(),
             "<" + std::string(root.Name()) + "> found, expected <sdf>" +
                 (urdf ? ", or <robot> of URDF" : ": the file is not SDF"));
    }
    if (!is_urdf_ && root.Attribute("version") == nullptr) {
      refuse(path_, root.GetLineNum(), "<sdf> without its version, such as version=\"1.6\"");
    }
    check(root);
  }

  const XMLElement& root() const { return *document_.RootElement(); }
  bool repeatable() const { return repeatable_; }
  bool is_urdf() const { return is_urdf_; }

 private:
  void check(const XMLElement& element) {
    const std::string_view name = element.Name();
    if (name == "include") {
      check_include(element);
    } else if (name == "mesh") {
      if (const XMLElement* uri = element.FirstChildElement("uri")) {
        found(*uri, text_of(*uri));
      } else if (const char* file = element.Attribute("filename")) {  // of URDF
        found(element, file);
      }
    } else if (name.compare(0, 6, "xacro:") == 0) {
      refuse(path_, element.GetLineNum(), "<" + std::string(name) + ">: this is xacro; name the file *.xacro");
    } else if (name == "physics") {
      check_engine(element);
    } else if (name == "actor" || (name == "plugin" && !is_left_out(element))) {
      repeatable_ = false;
    }
    for (const XMLElement* child = element.FirstChildElement(); child != nullptr; child = child->NextSiblingElement()) {
      check(*child);
    }
  }

  static bool is_left_out(const XMLElement& plugin) {
    const char* file = plugin.Attribute("filename");
    return file != nullptr && gazebo::is_left_out(file);
  }

  void check_engine(const XMLElement& physics) const {
    const char* type = physics.Attribute("type");
    if (type != nullptr && std::string(traits.engines).find(" " + std::string(type) + " ") == std::string::npos) {
      refuse(path_, physics.GetLineNum(),
             "<physics type=\"" + std::string(type) + "\">: expected " + traits.expected_engine);
    }
  }

  void check_include(const XMLElement& include) {
    const XMLElement* uri = include.FirstChildElement("uri");
    if (uri == nullptr) {
      refuse(path_, include.GetLineNum(), "<include> without <uri>");
    }
    std::string file = found(*uri, text_of(*uri));
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
    repeatable_ &= Checked(file, contents(file), find_, depth_ + 1).repeatable();
  }

  static std::string text_of(const XMLElement& element) {
    std::string text = element.GetText() == nullptr ? "" : element.GetText();
    const std::size_t first = text.find_first_not_of(" \t\r\n");
    const std::size_t last = text.find_last_not_of(" \t\r\n");
    return first == std::string::npos ? "" : text.substr(first, last - first + 1);
  }

  /// Where a resource is that an element names.
  std::string found(const XMLElement& element, const std::string& name) const {
    std::string where = find_(name);
    if (where.empty()) {
      const bool network = name.compare(0, 7, "http://") == 0 || name.compare(0, 8, "https://") == 0;
      const std::string_view own = element.Name();
      refuse(path_, element.GetLineNum(),
             "<" + std::string(own == "uri" ? element.Parent()->ToElement()->Name() : own) + "> of \"" + name +
                 "\": not found; " +
                 (network ? "nothing is fetched from the network: save it beside the file, and name it model://NAME"
                          : "put it beside the file, or its folder's parent into " + std::string(traits.model_path)));
    }
    return where;
  }

  std::string path_;
  const Find& find_;
  int depth_;
  bool repeatable_ = true;
  bool is_urdf_ = false;
  tinyxml2::XMLDocument document_;
};

/// What the library has to say, as one line: what it was that could not be read, and in which element.
std::string joined(const sdf::Errors& errors, const std::vector<std::string>& lines, bool urdf) {
  std::string all;
  for (const std::string& line : lines) {
    // What is not SDF is tried as URDF, too.
    if (urdf) {
      all += line.substr(0, line.find("at line ")) + "; ";
    } else if (line.find("urdf") == std::string::npos) {
      all += line + "; ";
    }
  }
  return all + (errors.empty() ? "Gazebo cannot read it" : errors.front().Message());
}

/// Reads a text; what the library says of it. Throws GazeboError if it is not understood.
std::vector<std::string> tried(const std::string& path, const std::string& text, const char* element, bool urdf) {
  const sdf::SDFPtr parsed(new sdf::SDF);
  sdf::Errors errors;
  const Captured captured;
  const bool read = sdf::init(parsed) && sdf::readString(text, parsed, errors);
  std::vector<std::string> lines = captured.lines();
  if (!read || (!urdf && !errors.empty()) || !parsed->Root()->HasElement(element)) {
    throw GazeboError(path + ": " + joined(errors, lines, urdf));
  }
  return lines;
}

/// A text that has been read before.
sdf::ElementPtr parsed(const std::string& text) {
  const Captured said_before;
  const sdf::SDFPtr document(new sdf::SDF);
  if (!sdf::init(document) || !sdf::readString(text, document)) {
    throw GazeboError("Gazebo cannot read the world of the mission");
  }
  return document->Root();
}

}  // namespace

sdf::ElementPtr UserWorld::world() const { return parsed(text)->GetElement("world"); }

sdf::ElementPtr UserFile::model() const { return parsed(text)->GetElement("model"); }

UserWorld read_world(const std::string& path, const Find& find) {
  UserWorld world;
  world.path = path;
  world.text = contents(path);
  const Checked checked(path, world.text, find);
  const XMLElement* first = checked.root().FirstChildElement("world");
  if (first == nullptr) {
    refuse(path, checked.root().GetLineNum(), "<sdf> without <world>: expected a world, in which robots are put");
  }
  if (const XMLElement* second = first->NextSiblingElement("world")) {
    refuse(path, second->GetLineNum(), "a second <world> found, expected one");
  }
  world.repeatable = checked.repeatable();
  world.warnings = tried(path, world.text, "world", false);
  return world;
}

UserFile read_model(const std::string& path, const Find& find) {
  const bool xacro = path.size() > 6 && path.compare(path.size() - 6, 6, ".xacro") == 0;
  const char* expanded = std::getenv("SWARMWRIGHT_MODEL_TEXT");
  if (xacro && expanded == nullptr) {
    throw GazeboError(path + ": xacro has to expand it first: `xacro " + path +
                      " > robot.urdf`, then --model robot.urdf");
  }
  UserFile file;
  file.text = contents(xacro ? expanded : path);
  const Checked checked(path, file.text, find, 0, true);
  const XMLElement* model = checked.root().FirstChildElement("model");
  if (!checked.is_urdf() && model == nullptr) {
    refuse(path, checked.root().GetLineNum(), "<sdf> without <model>: expected a model of a robot");
  }
  if (const XMLElement* second = model == nullptr ? nullptr : model->NextSiblingElement("model")) {
    refuse(path, second->GetLineNum(), "a second <model> found, expected one");
  }
  file.warnings = tried(path, file.text, "model", checked.is_urdf());
  return file;
}

sdf::ElementPtr parsed_world(const std::string& text) { return parsed(text)->GetElement("world"); }

}  // namespace swarmwright::gazebo
