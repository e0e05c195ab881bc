// @mark@; changes here are lost.
#pragma once

#include <string>

#include "value.hpp"

// The content of a file. Throws MappingError when it cannot be read or is no YAML.
Value read_yaml(const std::string& file);
