// @mark@; changes here are lost.
#pragma once

#include <string>

#include "value.hpp"

// Returns the content of a file. Throws MappingError if it cannot be read or is invalid YAML.
Value read_yaml(const std::string& file);
