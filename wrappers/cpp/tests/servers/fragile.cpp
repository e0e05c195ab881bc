// A simulation that fails in the way that its parameters ask for, and a server that is polled by a main loop.
//
//   fragile --broker URL --id N            run() has the loop
//   fragile --broker URL --id N --polled   the program has the loop

#include <swarmwright/swarmwright.hpp>

#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

/// Moves along a line; more than 1 is too far.
class Fragile : public swarmwright::Simulation {
 public:
  swarmwright::Description description() const override {
    swarmwright::Description says;
    says.title = "fragile";
    says.dimensions = 1;
    says.sensors = 1;
    says.actuators = 1;
    says.max_agents = 4;
    says.metrics = {{"way"}};
    return says;
  }

  void reset(const swarmwright::Parameters& parameters, std::uint64_t seed) override {
    trouble_ = parameters.text("trouble", "too far");
    if (trouble_ == "reset") {
      throw std::runtime_error("reset does not work");
    }
    speed_ = parameters.number("speed", 0, 1, 1);
    x_ = 1e-3 * static_cast<double>(seed % 2);
    steps_ = 0;
    acting_ = {0};
  }

  const std::vector<std::uint32_t>& acting() override {
    if (trouble_ == "order") {
      acting_ = {1, 0};
    } else if (trouble_ == "agent") {
      acting_ = {7};
    }
    return acting_;
  }

  void sense(std::uint32_t /*agent*/, swarmwright::Span<float> sensors) override {
    if (trouble_ == "sense") {
      throw std::string("nothing can be seen");
    }
    sensors[0] = trouble_ == "nan" ? std::nanf("") : static_cast<float>(x_);
  }

  void step(swarmwright::Span<const float> actuators) override {
    x_ += speed_ * static_cast<double>(actuators[0]);
    if (trouble_ == "too far" && x_ > 1) {
      try {
        throw std::out_of_range("x is more than 1");
      } catch (...) {
        std::throw_with_nested(std::runtime_error("the wheel came off"));
      }
    }
    if (++steps_ >= 5) {
      acting_.clear();
    }
  }

  double fitness() override { return trouble_ == "fitness" ? std::nan("") : x_; }

  std::vector<double> metrics() override {
    return trouble_ == "metrics" ? std::vector<double>{1, 2} : std::vector<double>{std::abs(x_)};
  }

 private:
  std::string trouble_;
  double speed_ = 1;
  double x_ = 0;
  int steps_ = 0;
  std::vector<std::uint32_t> acting_;
};

volatile std::sig_atomic_t told_to_stop = 0;

}  // namespace

int main(int count, char** values) {
  if (std::string(values[count - 1]) != "--polled") {
    return swarmwright::serve<Fragile>(count, values);
  }
  std::signal(SIGTERM, [](int) { told_to_stop = 1; });
  Fragile only;
  swarmwright::Server server(only, swarmwright::arguments(count - 1, values));
  while (told_to_stop == 0) {
    server.poll(std::chrono::milliseconds(20));
  }
  return 0;
}
