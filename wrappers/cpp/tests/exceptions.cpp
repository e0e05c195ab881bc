// Exceptions of simulations are reported with their type, and invalid descriptions are refused with a reason.

#include "check.hpp"

#include <swarmwright/swarmwright.hpp>

#include <array>
#include <exception>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

struct Odd {};

struct WheelError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

template <class Throw>
std::string words(Throw&& raise) {
  const swarmwright_status status = swarmwright::detail::guarded(raise);
  CHECK_EQUAL(status, SWARMWRIGHT_FAILED);
  return swarmwright_error();
}

void exceptions_become_words() {
  CHECK_EQUAL(words([] { throw std::runtime_error("the wheel came off"); }), "std::runtime_error: the wheel came off");
  CHECK_EQUAL(words([] { throw WheelError("off"); }).find("WheelError: off") != std::string::npos, true);
  CHECK_EQUAL(words([] { throw std::string("text"); }), "text");
  CHECK_EQUAL(words([] { throw "text"; }), "text");
  CHECK_EQUAL(words([] { throw Odd(); }).find("an exception of type ") == 0, true);
  CHECK_EQUAL(words([] {
                try {
                  throw std::out_of_range("index 7");
                } catch (...) {
                  std::throw_with_nested(std::runtime_error("no such wheel"));
                }
              }),
              "no such wheel\n  because of std::out_of_range: index 7");
}

void parameter_errors_keep_their_parts() {
  const swarmwright_status status =
      swarmwright::detail::guarded([] { throw swarmwright::ParameterError("speed", "3 found, expected less"); });
  CHECK_EQUAL(status, SWARMWRIGHT_INVALID);
  CHECK_EQUAL(std::string(swarmwright_error()), "parameter speed: 3 found, expected less");
  CHECK_EQUAL(std::string(swarmwright_error_parameter()), "speed");
  CHECK_EQUAL(std::string(swarmwright_error_reason()), "3 found, expected less");
  swarmwright_set_error("plain");
  CHECK_EQUAL(swarmwright_error_parameter() == nullptr, true);
  CHECK_EQUAL(std::string(swarmwright_error()), "plain");
}

/// Describes itself as told.
class Described : public swarmwright::Simulation {
 public:
  explicit Described(swarmwright::Description says) : says_(std::move(says)) {}

  swarmwright::Description description() const override { return says_; }
  void reset(const swarmwright::Parameters&, std::uint64_t) override {}
  const std::vector<std::uint32_t>& acting() override { return no_agents_; }
  void sense(std::uint32_t, swarmwright::Span<float>) override {}
  void step(swarmwright::Span<const float>) override {}
  double fitness() override { return 0; }

 private:
  swarmwright::Description says_;
  std::vector<std::uint32_t> no_agents_;
};

void what_cannot_be_served_says_why() {
  swarmwright::Description good;
  good.title = "line";
  good.sensors = good.actuators = 1;
  const auto refused = [&](auto change) {
    swarmwright::Description says = good;
    change(says);
    swarmwright::Options options;
    options.broker = "mqtt://127.0.0.1:1";
    return check::thrown<std::invalid_argument>([&] {
      Described simulation(says);
      const swarmwright::Server server(simulation, options);
    });
  };
  CHECK_EQUAL(refused([](auto& says) { says.title = ""; }), "the title has 0 bytes, expected 1 to 1000");
  CHECK_EQUAL(refused([](auto& says) { says.title = "\xff"; }), "swarmwright_description.title: is not valid UTF-8");
  CHECK_EQUAL(refused([](auto& says) { says.sensors = 0; }), "line: 0 sensors, expected 1 to 1000000");
  CHECK_EQUAL(refused([](auto& says) { says.actuators = 0; }), "line: 0 actuators, expected 1 to 1000000");
  CHECK_EQUAL(refused([](auto& says) { says.metrics = {{"a"}, {"a"}}; }), "line: metric \"a\" occurs twice");
  CHECK_EQUAL(refused([](auto& says) { says.metrics = {{"1a"}}; }),
              "line: metric \"1a\": a name must be a letter or _, then letters, digits and _, and not fitness");
  CHECK_EQUAL(refused([](auto& says) {
                says.determinism = swarmwright::Determinism::statistical;
                says.tolerance = -1;
              }),
              "line: the tolerance is -1, expected a finite number of at least 0");
  CHECK_EQUAL(refused([](auto& says) {
                says.determinism = static_cast<swarmwright::Determinism>(4);
              }).rfind("line: the determinism is 4, expected", 0),
              0U);
  CHECK_EQUAL(refused([](auto&) {}).find("no broker answers at mqtt://127.0.0.1:1") != std::string::npos, true);
  CHECK_THROWS(std::invalid_argument, "the factory of simulations returned a null pointer",
               swarmwright::Server([] { return std::unique_ptr<swarmwright::Simulation>(); }));
}

void bodies_take_doubles() {
  const auto agent = [](double x) { return swarmwright::Body{"agent", x, 2 * x, "free"}; };
  CHECK_EQUAL(agent(1.5).y, 3.0);
  const auto goal = [](float x) { return swarmwright::Body{"goal", x, x}; };
  CHECK_EQUAL(goal(0.5F).x, 0.5);
}

void spans_are_stretches() {
  std::vector<float> numbers{1, 2, 3};
  const swarmwright::Span<const float> all(numbers);
  CHECK_EQUAL(all.subspan(1, 2)[1], 3.0F);
  CHECK_EQUAL(swarmwright::Span<float>().empty(), true);
  std::array<int, 2> pair{1, 2};
  int sum = 0;
  for (const int number : swarmwright::Span<int>(pair)) {
    sum += number;
  }
  CHECK_EQUAL(sum, 3);
}

}  // namespace

int main() {
  exceptions_become_words();
  parameter_errors_keep_their_parts();
  what_cannot_be_served_says_why();
  bodies_take_doubles();
  spans_are_stretches();
  return check::status();
}
