// The example server: Minisim, called by the wrapper.
//
//   minisim --broker mqtt://localhost:1883 --id 5

#include "minisim/minisim.hpp"

int main(int count, char** values) { return swarmwright::serve<minisim::Minisim>(count, values); }
