/* The C interface as C uses it. */

#define _POSIX_C_SOURCE 200112L  // setenv

#include <swarmwright/swarmwright.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int failures = 0;

static void check(int holds, const char* label, int line) {
  if (!holds) {
    ++failures;
    fprintf(stderr, "line %d: %s\n    error: %s\n", line, label, swarmwright_error());
  }
}
#define CHECK(holds) check((holds), #holds, __LINE__)
#define CHECK_SAYS(text) CHECK(strstr(swarmwright_error(), text) != NULL)

static swarmwright_status create(void* context, void** simulation) {
  *simulation = context;
  return SWARMWRIGHT_OK;
}

static swarmwright_status refuse(void* simulation, const swarmwright_parameters* parameters, uint64_t seed) {
  (void)simulation, (void)parameters, (void)seed;
  swarmwright_set_parameter_error("speed", "too much");
  return SWARMWRIGHT_INVALID;
}

static swarmwright_status no_agents(void* simulation, const uint32_t** agents, size_t* count) {
  (void)simulation;
  *agents = NULL;
  *count = 0;
  return SWARMWRIGHT_OK;
}

static swarmwright_status nothing(void* simulation, uint32_t agent, float* sensors) {
  (void)simulation, (void)agent, (void)sensors;
  return SWARMWRIGHT_OK;
}

static swarmwright_status stay(void* simulation, const float* actuators, size_t count) {
  (void)simulation, (void)actuators, (void)count;
  return SWARMWRIGHT_OK;
}

static swarmwright_status zero(void* simulation, double* fitness) {
  (void)simulation;
  *fitness = 0;
  return SWARMWRIGHT_OK;
}

static void parameters_are_read(void) {
  swarmwright_parameters* read = NULL;
  CHECK(swarmwright_parameters_new("{\"n\": 3, \"x\": 0.5}", &read) == SWARMWRIGHT_OK);
  int64_t n = 0;
  double x = 0;
  double absent = 7;
  CHECK(swarmwright_parameter_integer(read, "n", 0, 5, &n) == SWARMWRIGHT_OK && n == 3);
  CHECK(swarmwright_parameter_number(read, "x", -INFINITY, INFINITY, &x) == SWARMWRIGHT_OK && x == 0.5);
  CHECK(swarmwright_parameter_number(read, "y", 0, 1, &absent) == SWARMWRIGHT_OK && absent == 7);
  CHECK(swarmwright_parameter_integer(read, "x", 0, 5, &n) == SWARMWRIGHT_INVALID && n == 3);
  CHECK(strcmp(swarmwright_error_parameter(), "x") == 0);
  CHECK(strcmp(swarmwright_parameters_json(read), "{\"n\":3,\"x\":0.5}") == 0);
  CHECK(swarmwright_parameter_integer(read, "n", 0, 5, NULL) == SWARMWRIGHT_INVALID);
  CHECK_SAYS("n: must not be a null pointer");
  CHECK(swarmwright_parameter_integer(NULL, "n", 0, 5, &n) == SWARMWRIGHT_INVALID);
  CHECK_SAYS("the parameters: must not be a null pointer");
  CHECK(swarmwright_parameter_integer(read, "\xff", 0, 5, &n) == SWARMWRIGHT_INVALID);
  swarmwright_parameters_free(read);
  swarmwright_parameters_free(NULL);
  CHECK(swarmwright_parameters_new("{", &read) == SWARMWRIGHT_INVALID);
  CHECK_SAYS("not a JSON object");
}

static void what_is_wrong_is_refused(void) {
  swarmwright_options options = SWARMWRIGHT_OPTIONS;
  swarmwright_description description = SWARMWRIGHT_DESCRIPTION;
  swarmwright_simulation simulation = {0};
  swarmwright_server* server = NULL;
  swarmwright_plugin* plugin = NULL;
  options.broker = "mqtt://127.0.0.1:1";
  description.title = "nothing";
  description.sensors = description.actuators = 1;
  CHECK(swarmwright_server_open(&options, &description, &simulation, &server) == SWARMWRIGHT_INVALID);
  CHECK_SAYS("swarmwright_simulation: its size is 0");
  simulation.size = sizeof simulation;
  CHECK(swarmwright_server_open(&options, &description, &simulation, &server) == SWARMWRIGHT_INVALID);
  CHECK_SAYS("swarmwright_simulation.create: must not be a null pointer");
  simulation.create = create;
  simulation.reset = refuse;
  simulation.acting = no_agents;
  simulation.sense = nothing;
  simulation.step = stay;
  simulation.fitness = zero;
  CHECK(swarmwright_server_open(&options, &description, &simulation, &server) == SWARMWRIGHT_FAILED);
  CHECK_SAYS("no broker answers at mqtt://127.0.0.1:1");
  CHECK(swarmwright_plugin_open(&options, &description, &plugin) == SWARMWRIGHT_FAILED);
  CHECK(swarmwright_server_open(NULL, &description, &simulation, &server) == SWARMWRIGHT_INVALID);
  CHECK_SAYS("swarmwright_options: must not be a null pointer");
  // Where no prefix is named it is that of the environment; an empty one is none.
  CHECK(setenv("SWARMWRIGHT_PREFIX", "swarm/#", 1) == 0);
  CHECK(swarmwright_server_open(&options, &description, &simulation, &server) == SWARMWRIGHT_INVALID);
  CHECK_SAYS("topic prefix \"swarm/#\"");
  options.prefix = "";
  CHECK(swarmwright_server_open(&options, &description, &simulation, &server) == SWARMWRIGHT_FAILED);
  CHECK(unsetenv("SWARMWRIGHT_PREFIX") == 0);
  options.step_timeout = NAN;
  CHECK(swarmwright_server_open(&options, &description, &simulation, &server) == SWARMWRIGHT_INVALID);
  CHECK_SAYS("the step time-out is NaN s");
  options.size = 1000;
  CHECK(swarmwright_server_open(&options, &description, &simulation, &server) == SWARMWRIGHT_INVALID);
  CHECK_SAYS("swarmwright_options: its size is 1000");
  CHECK(swarmwright_server_run(NULL) == SWARMWRIGHT_INVALID);
  CHECK(swarmwright_server_close(NULL) == SWARMWRIGHT_OK);
  CHECK(swarmwright_plugin_close(NULL) == SWARMWRIGHT_OK);
  CHECK(swarmwright_plugin_finish(NULL, 0, NULL) == SWARMWRIGHT_INVALID);
  swarmwright_server_stop(NULL);
  CHECK(server == NULL && plugin == NULL);
}

int main(void) {
  CHECK(swarmwright_abi() == SWARMWRIGHT_ABI);
  CHECK(strcmp(swarmwright_version(), "0.1.0") == 0);
  CHECK(strcmp(swarmwright_error(), "") == 0);
  parameters_are_read();
  what_is_wrong_is_refused();
  fprintf(stderr, failures == 0 ? "ok\n" : "%d failures\n", failures);
  return failures != 0;
}
