/*
 * Swarmwright's simulation wrapper for C: a simulator becomes a simulation server on an MQTT broker.
 *
 * Who has the loop decides which of two objects to use:
 *
 *   swarmwright_server   calls functions of yours: reset, sense, step, ...; either in a loop of its own
 *                        (swarmwright_server_run) or whenever you let it (swarmwright_server_poll).
 *   swarmwright_plugin   calls nothing: your simulator goes on with its loop, looks in with swarmwright_plugin_poll
 *                        and is told to reset, or what the agents do.
 *
 * Rules that hold for all of it:
 *
 *   - A function that returns a swarmwright_status returns SWARMWRIGHT_OK or says why not, in swarmwright_error().
 *   - Nothing is thrown or unwound across this interface, in either direction.
 *   - Nothing is allocated on one side and freed on the other. A text or an array that is handed over is copied before
 *     the call returns; one that is given out stays as long as its description says.
 *   - Texts are UTF-8 and end with NUL, unless a length stands beside them. Numbers are IEEE 754.
 *   - A structure that begins with `size` is to have it set to its sizeof: use the macros below, which have the
 *     defaults.
 *
 * Link with libswarmwright. A broker that the same user runs on this machine (`swarmwright broker`) admits the program
 * without more; the credentials of others come from the environment: SWARMWRIGHT_USERNAME and SWARMWRIGHT_PASSWORD or
 * SWARMWRIGHT_PASSWORD_FILE, and for TLS SWARMWRIGHT_CA_FILE, and SWARMWRIGHT_CERTIFICATE_FILE with
 * SWARMWRIGHT_KEY_FILE where the broker requires a client certificate.
 */
#ifndef SWARMWRIGHT_H
#define SWARMWRIGHT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/** The version of this interface; swarmwright_abi() says which one the library has. */
#define SWARMWRIGHT_ABI 1

#ifdef __cplusplus
extern "C" {
#define SWARMWRIGHT_NOEXCEPT noexcept
#else
#define SWARMWRIGHT_NOEXCEPT
#endif

/** How a call went. */
typedef int32_t swarmwright_status;
/** All went well. */
#define SWARMWRIGHT_OK 0
/** What was given cannot be used, or the call cannot be made now. */
#define SWARMWRIGHT_INVALID 1
/** It was tried in vain. */
#define SWARMWRIGHT_FAILED 2

/** SWARMWRIGHT_ABI as the library was compiled with it. */
uint32_t swarmwright_abi(void) SWARMWRIGHT_NOEXCEPT;
/** The library's version, such as "0.1.0". */
const char* swarmwright_version(void) SWARMWRIGHT_NOEXCEPT;

/* ---- Errors. Each thread keeps its last one. ---- */

/** What the last call that went wrong said; never null. */
const char* swarmwright_error(void) SWARMWRIGHT_NOEXCEPT;
/** The parameter of an episode that it was about; null if it was about none. */
const char* swarmwright_error_parameter(void) SWARMWRIGHT_NOEXCEPT;
/** What is wrong with that parameter; never null. */
const char* swarmwright_error_reason(void) SWARMWRIGHT_NOEXCEPT;

/** For your functions: says why they return something other than SWARMWRIGHT_OK. It reaches the optimization tool. */
void swarmwright_set_error(const char* text) SWARMWRIGHT_NOEXCEPT;
/** For your reset, before it returns SWARMWRIGHT_INVALID: says which parameter cannot be used, and why. The functions
 * that read parameters have said it already. */
void swarmwright_set_parameter_error(const char* parameter, const char* reason) SWARMWRIGHT_NOEXCEPT;

/* ---- Parameters of an episode, as they stand in the experiment. ---- */

/** Parameters that a reset is about; they stay until it has returned, or until the next poll. */
typedef struct swarmwright_parameters swarmwright_parameters;

/** All of them as a JSON object; it stays as long as they do. */
const char* swarmwright_parameters_json(const swarmwright_parameters* parameters) SWARMWRIGHT_NOEXCEPT;
/** Whether the experiment sets a parameter. */
bool swarmwright_parameter_given(const swarmwright_parameters* parameters, const char* name) SWARMWRIGHT_NOEXCEPT;

/*
 * Each of these writes what the experiment sets, and leaves alone what it does not set: put the default there before.
 * What does not fit is SWARMWRIGHT_INVALID, and swarmwright_error() says what was found and what is expected.
 */

/** A whole number in low..high; 13.0 counts as 13. */
swarmwright_status swarmwright_parameter_integer(const swarmwright_parameters* parameters, const char* name,
                                                 int64_t low, int64_t high, int64_t* value) SWARMWRIGHT_NOEXCEPT;
/** A finite number in low..high; a bound that is infinite is none. */
swarmwright_status swarmwright_parameter_number(const swarmwright_parameters* parameters, const char* name, double low,
                                                double high, double* value) SWARMWRIGHT_NOEXCEPT;
/** A finite number in low..high, rounded to binary32 before it is compared. */
swarmwright_status swarmwright_parameter_single(const swarmwright_parameters* parameters, const char* name, float low,
                                                float high, float* value) SWARMWRIGHT_NOEXCEPT;
/** True or false. */
swarmwright_status swarmwright_parameter_flag(const swarmwright_parameters* parameters, const char* name,
                                              bool* value) SWARMWRIGHT_NOEXCEPT;
/** The 64 bits of a seed: any whole number from -2^63 to 2^64 - 1. */
swarmwright_status swarmwright_parameter_seed(const swarmwright_parameters* parameters, const char* name,
                                              uint64_t* value) SWARMWRIGHT_NOEXCEPT;
/** A text of so many bytes, without a NUL behind it; it stays as long as the parameters do. */
swarmwright_status swarmwright_parameter_text(const swarmwright_parameters* parameters, const char* name,
                                              const char** text, size_t* length) SWARMWRIGHT_NOEXCEPT;
/** One of `count` texts, as its index. */
swarmwright_status swarmwright_parameter_choice(const swarmwright_parameters* parameters, const char* name,
                                                const char* const* choices, size_t count,
                                                size_t* index) SWARMWRIGHT_NOEXCEPT;
/** A list of least..most finite numbers, each in low..high; it stays as long as the parameters do. */
swarmwright_status swarmwright_parameter_numbers(const swarmwright_parameters* parameters, const char* name,
                                                 size_t least, size_t most, double low, double high,
                                                 const double** values, size_t* count) SWARMWRIGHT_NOEXCEPT;
/** A position [x, y] in 0..width and 0..height, borders included, rounded to binary32: two numbers. */
swarmwright_status swarmwright_parameter_position(const swarmwright_parameters* parameters, const char* name,
                                                  float width, float height, float* position) SWARMWRIGHT_NOEXCEPT;
/** At most `most` positions [[x, y], ..], as above: twice `count` numbers, which stay as long as the parameters do. */
swarmwright_status swarmwright_parameter_positions(const swarmwright_parameters* parameters, const char* name,
                                                   uint32_t most, float width, float height, const float** positions,
                                                   size_t* count) SWARMWRIGHT_NOEXCEPT;

/** Parameters made of a JSON object, to test a simulation with. */
swarmwright_status swarmwright_parameters_new(const char* json,
                                              swarmwright_parameters** parameters) SWARMWRIGHT_NOEXCEPT;
/** Frees what swarmwright_parameters_new made, and nothing else. */
void swarmwright_parameters_free(swarmwright_parameters* parameters) SWARMWRIGHT_NOEXCEPT;

/* ---- What is offered. ---- */

/** A number that the simulation measures in an episode beside the fitness. */
typedef struct swarmwright_metric {
  /** A letter or _, then letters, digits and _; not "fitness". */
  const char* name;
  /** agents, steps, metres, ...; null for a mere number. */
  const char* unit;
  /** Meaning, in a sentence; may be null. */
  const char* description;
} swarmwright_metric;

/** How far two evaluations of one episode with one controller agree, wherever they were made: nothing is said of it. */
#define SWARMWRIGHT_UNDECLARED 0
/** To the bit: all follows from parameters, seed and actuators. */
#define SWARMWRIGHT_BITWISE 1
/** Within a tolerance. */
#define SWARMWRIGHT_STATISTICAL 2
/** Not at all. */
#define SWARMWRIGHT_NONE 3

/** What a simulation says of itself. */
typedef struct swarmwright_description {
  size_t size;
  /** The title that experiments name. */
  const char* title;
  /** Spatial dimensions. */
  uint32_t dimensions;
  /** Most agents; 0 for no limit. */
  uint32_t max_agents;
  /** Numbers that an agent senses, at least 1. */
  uint32_t sensors;
  /** Numbers that an agent is given to do, at least 1. */
  uint32_t actuators;
  /** What is measured, in this order; null if nothing is. */
  const swarmwright_metric* metrics;
  size_t metric_count;
  /** One of the above. */
  int32_t determinism;
  /** Of SWARMWRIGHT_STATISTICAL: how far fitness and metrics may differ, as a part of the larger one, absolute below 1.
   */
  double tolerance;
} swarmwright_description;

/** The defaults of a description: two dimensions, no limit. */
#define SWARMWRIGHT_DESCRIPTION \
  { sizeof(swarmwright_description), NULL, 2, 0, 0, 0, NULL, 0, SWARMWRIGHT_UNDECLARED, 0.0 }

/** What a notice is about. */
#define SWARMWRIGHT_NOTICE_READY 0
#define SWARMWRIGHT_NOTICE_BUSY 1
#define SWARMWRIGHT_NOTICE_WARNING 2
#define SWARMWRIGHT_NOTICE_LOST 3

/** How a server is to be run. */
typedef struct swarmwright_options {
  size_t size;
  /** mqtt://, mqtts://, ws://, wss:// or unix:///PATH; null for the environment's SWARMWRIGHT_BROKER, else
   * mqtt://localhost:1883. */
  const char* broker;
  /** The server's id, from 0, which no other server on the broker has. */
  uint64_t id;
  /** What stands before all topics, "" for nothing; null for the environment's SWARMWRIGHT_PREFIX, else nothing. */
  const char* prefix;
  /** Seconds after which a step that misses actuators is given up. */
  double step_timeout;
  /** Threads of an offloaded evaluation, each with a simulation of its own; 0 for one per processor. */
  uint32_t threads;
  /** Is told what the operator should know, while the server runs or is polled, on that thread; may be null. */
  void (*notice)(void* context, int32_t kind, const char* text);
  /** Handed to `notice`. */
  void* context;
} swarmwright_options;

/** The defaults of options. */
#define SWARMWRIGHT_OPTIONS \
  { sizeof(swarmwright_options), NULL, 1, NULL, 60.0, 1, NULL, NULL }

/* ---- What an episode looks like. ---- */

/**
 * The world from above, filled by the functions below within one call of your `scene`. Lengths are metres or cells,
 * (0, 0) is at the bottom left, angles are radians, counter-clockwise. What cannot be is SWARMWRIGHT_INVALID.
 */
typedef struct swarmwright_scene swarmwright_scene;

/** One thing in it. */
typedef struct swarmwright_body {
  size_t size;
  /** agent, defender, goal, exit, obstacle, or any other word. */
  const char* kind;
  /** free, arrived, caught, crashed, out, or any other word; null for none. */
  const char* state;
  float x;
  float y;
  /** 0 for a point. */
  float radius;
  /** Where it looks, from the x axis; NaN for nowhere. Bodies with a heading are drawn in their true size. */
  float heading;
  /** A number that gives it a colour; NaN for none. */
  float value;
  /** Which agent it is; -1: bodies of the kind agent are the agents in their order. */
  int64_t agent;
  /** A short text beside it; null for none. */
  const char* label;
} swarmwright_body;

/** The extent of the world; `grid`: its unit is a cell; `message`: a line to show above, or null. */
swarmwright_status swarmwright_scene_world(swarmwright_scene* scene, float width, float height, bool grid,
                                           const char* message) SWARMWRIGHT_NOEXCEPT;
/** Where the bottom left corner is in the simulation's own coordinates: numbers beside pictures are those. Positions of
 * a scene stay distances from that corner. */
swarmwright_status swarmwright_scene_origin(swarmwright_scene* scene, float x, float y) SWARMWRIGHT_NOEXCEPT;
/** Adds a body above those that are there; `index`, which may be null, gets its number from 0. */
swarmwright_status swarmwright_scene_body(swarmwright_scene* scene, const swarmwright_body* body,
                                          uint32_t* index) SWARMWRIGHT_NOEXCEPT;
/** Adds what a sensor looks along: `angle` from the heading of the body, `start` from its middle, `reading` 0 to 1 or
 * NaN. */
swarmwright_status swarmwright_scene_ray(swarmwright_scene* scene, uint32_t body, float angle, float start,
                                         float length, float reading) SWARMWRIGHT_NOEXCEPT;
/** Adds a line between two bodies, of which the second hears the first. */
swarmwright_status swarmwright_scene_link(swarmwright_scene* scene, uint32_t from, uint32_t to) SWARMWRIGHT_NOEXCEPT;
/** Adds a part of the floor, 0 black to 1 white: a polygon of `count` corners x, y, x, y, ..; with one, a circle around
 * it; with none, the whole floor. */
swarmwright_status swarmwright_scene_patch(swarmwright_scene* scene, float grey, float radius, const float* corners,
                                           size_t count, const char* name) SWARMWRIGHT_NOEXCEPT;
/** Adds a wall along `count` points, or with `solid` an obstacle with these corners. */
swarmwright_status swarmwright_scene_wall(swarmwright_scene* scene, const float* points, size_t count,
                                          bool solid) SWARMWRIGHT_NOEXCEPT;
/** Adds a lamp; intensity 0 is off. */
swarmwright_status swarmwright_scene_light(swarmwright_scene* scene, float x, float y,
                                           float intensity) SWARMWRIGHT_NOEXCEPT;
/** Chooses the look of bodies of a kind and state: #rrggbb, and circle, cross, triangle, star, square, diamond,
 * pentagon or hexagon; null for the default. */
swarmwright_status swarmwright_scene_style(swarmwright_scene* scene, const char* kind, const char* state,
                                           const char* color, const char* shape) SWARMWRIGHT_NOEXCEPT;
/** Says what the values of bodies are, and which have the first and the last colour. */
swarmwright_status swarmwright_scene_scale(swarmwright_scene* scene, const char* name, float low,
                                           float high) SWARMWRIGHT_NOEXCEPT;

/* ---- A server that calls your functions. ---- */

/**
 * Your functions. They return SWARMWRIGHT_OK, or after swarmwright_set_error something else: then the episode has
 * failed, the optimization tool is told, and the next one begins with reset. None may throw.
 *
 * An object is used by one thread at a time, not always the same one: steps over the broker by the thread that runs or
 * polls the server, offloaded evaluation by others. A server makes several objects, for episodes that are stepped side
 * by side.
 */
typedef struct swarmwright_simulation {
  size_t size;
  /** Handed to `create`. */
  void* context;
  /** Not 0: there can be only one object, as when it drives another program. */
  uint32_t only_one;
  /** Makes an object; called by one thread at a time. */
  swarmwright_status (*create)(void* context, void** simulation);
  /** Ends an object; null if there is nothing to do. All are ended when swarmwright_server_close returns. */
  void (*destroy)(void* simulation);
  /** Goes to the start of an episode; `seed` is the parameter "seed", different in each of several episodes, 0 by
   * default. SWARMWRIGHT_INVALID: a parameter cannot be used, and swarmwright_set_parameter_error says which. */
  swarmwright_status (*reset)(void* simulation, const swarmwright_parameters* parameters, uint64_t seed);
  /** The agents whose actuators the next step needs, ascending from 0; the array stays until the next call. None: the
   * episode has ended, or `done` says that it has not and the simulation steers its agents itself. */
  swarmwright_status (*acting)(void* simulation, const uint32_t** agents, size_t* count);
  /** Whether the episode has ended; null: when no agent acts. */
  swarmwright_status (*done)(void* simulation, bool* done);
  /** Writes what an acting agent senses: as many finite numbers as the description says. */
  swarmwright_status (*sense)(void* simulation, uint32_t agent, float* sensors);
  /** Moves on by one step. A row for each acting agent, in their order, one behind the other: `count` numbers in -1..1.
   */
  swarmwright_status (*step)(void* simulation, const float* actuators, size_t count);
  /** Fitness of the episode so far, a finite number; larger is better. */
  swarmwright_status (*fitness)(void* simulation, double* fitness);
  /** The metrics of the episode so far, as many as the description has; null if it has none. */
  swarmwright_status (*metrics)(void* simulation, double* metrics);
  /** Shows the episode as it is now, if it is to be shown, for so many milliseconds (250 if you write nothing,
   * 0 to go on at once); null if there is nothing to see. */
  swarmwright_status (*show)(void* simulation, uint32_t* milliseconds);
  /** Says what the episode looks like now, to be shown elsewhere for so many milliseconds: calls
   * swarmwright_scene_world, then the others as needed. Null: it has no scenes. */
  swarmwright_status (*scene)(void* simulation, swarmwright_scene* scene, uint32_t* milliseconds);
} swarmwright_simulation;

/** A server. */
typedef struct swarmwright_server swarmwright_server;

/** Connects to the broker and offers a simulation. SWARMWRIGHT_FAILED: no broker, no access, the id is taken. What the
 * pointers point to is copied; `context` and the functions are to stay until the server is closed. */
swarmwright_status swarmwright_server_open(const swarmwright_options* options,
                                           const swarmwright_description* description,
                                           const swarmwright_simulation* simulation,
                                           swarmwright_server** server) SWARMWRIGHT_NOEXCEPT;
/** Serves until swarmwright_server_stop, then leaves the broker. */
swarmwright_status swarmwright_server_run(const swarmwright_server* server) SWARMWRIGHT_NOEXCEPT;
/** One turn, for those who have a loop of their own: waits for at most `seconds` for something to happen and does what
 * is due. What is not polled for 45 s loses its connection, until it is polled again. */
swarmwright_status swarmwright_server_poll(const swarmwright_server* server, double seconds) SWARMWRIGHT_NOEXCEPT;
/** Makes swarmwright_server_run return within 0.1 s, once your functions have returned. From any thread, from your
 * functions and from signal handlers. */
void swarmwright_server_stop(const swarmwright_server* server) SWARMWRIGHT_NOEXCEPT;
/** Gives up what is under way, leaves the broker, waits for an episode that is evaluated elsewhere, ends all objects
 * and frees the server. No other thread may use it any more. Null is nothing to do. */
swarmwright_status swarmwright_server_close(swarmwright_server* server) SWARMWRIGHT_NOEXCEPT;

/* ---- A simulator that moves the robots of missions. ---- */

/*
 * The built-in simulation `arena` has missions, robots with sensors, metrics. With these functions another simulator
 * takes the place of its motions and collisions: it is given what drives are to do, and says where all are. All the
 * rest stays the same, so that one experiment runs in many simulators.
 */

/** Where something is. */
typedef struct swarmwright_pose {
  /** Metres. */
  float x;
  float y;
  /** Radians counter-clockwise from x. */
  float heading;
} swarmwright_pose;

/** What a drive is to do in a step, in the frame of the robot, its noise included. The wheels of a differential drive
 * have the speeds forward - turn * wheel_base / 2 (left) and forward + turn * wheel_base / 2 (right). */
typedef struct swarmwright_motion {
  /** m/s ahead, and to the left: 0 of robots with wheels. */
  float forward;
  float sideways;
  /** rad/s counter-clockwise. */
  float turn;
} swarmwright_motion;

/** A wall, or a part of the floor with a colour of its own. */
typedef struct swarmwright_polygon {
  /** Corners counter-clockwise, metres: x and y of each. */
  const float* points;
  /** Number of corners. */
  size_t count;
  /** Of a wall, metres. */
  float height;
  /** Of the floor, 0 black to 1 white; below 0: black or white, drawn anew for each episode. */
  float grey;
} swarmwright_polygon;

typedef struct swarmwright_light {
  /** Metres. */
  float x;
  float y;
  float z;
  /** 1 of the reference model's. */
  float intensity;
} swarmwright_light;

/** What robots of a kind are. */
typedef struct swarmwright_robot {
  /** Metres. */
  float radius;
  float height;
  /** Kilograms. */
  float mass;
  /** Between the wheels of a differential drive, metres; 0 for other drives. */
  float wheel_base;
  /** Of a wheel or of the robot, m/s. */
  float top_speed;
  /** Largest change of velocity by the drive, m/s^2. */
  float acceleration;
  /** Where proximity rays begin, from the middle, and how far they reach from there, metres. */
  float ray_start;
  float ray_range;
  /** Their directions, radians counter-clockwise from ahead. */
  const float* rays;
  size_t ray_count;
} swarmwright_robot;

/** Something that robots can push: a disc or a box. */
typedef struct swarmwright_object {
  /** Of a disc, metres; 0 for a box. */
  float radius;
  /** Sides of a box along its heading and across it, metres. */
  float width;
  float depth;
  /** Metres. */
  float height;
  /** Kilograms. */
  float mass;
  /** Coefficient of friction with the floor. */
  float friction;
} swarmwright_object;

/** What a simulator is to build; the same for all episodes of a mission. */
typedef struct swarmwright_world {
  size_t size;
  /** Seconds of a step. */
  float tick;
  /** Of the floor beside the patches, 0 black to 1 white. */
  float grey;
  /** The first one is the outline, with the robots inside, the others are obstacles. */
  const swarmwright_polygon* walls;
  size_t wall_count;
  /** For pictures, and for sensors of the simulator's own; later ones lie on earlier ones. */
  const swarmwright_polygon* patches;
  size_t patch_count;
  const swarmwright_light* lights;
  size_t light_count;
  const swarmwright_robot* models;
  size_t model_count;
  /** The model of each robot. */
  const uint32_t* robots;
  size_t robot_count;
  const swarmwright_object* objects;
  size_t object_count;
} swarmwright_world;

/** How an episode begins. */
typedef struct swarmwright_start {
  size_t size;
  const swarmwright_world* world;
  /** Whether the world differs from that of the episode before; if not, robots and objects are put back. */
  bool changed;
  /** Where they are, as many as the world has. */
  const swarmwright_pose* robots;
  const swarmwright_pose* objects;
  /** The parameter "seed", different in each of several episodes, 0 by default. */
  uint64_t seed;
} swarmwright_start;

/** Your simulator and its functions, which return, and are called by threads, as those of swarmwright_simulation. What
 * they are given stays until they return. */
typedef struct swarmwright_physics {
  size_t size;
  /** Its name in experiments: "arena-" and the simulator's, by which they know what it is. */
  const char* title;
  /** SWARMWRIGHT_BITWISE, ..: whether it repeats episodes. */
  int32_t determinism;
  /** As in swarmwright_description. */
  double tolerance;
  /** Handed to `create`. */
  void* context;
  /** Not 0: there can be only one object in a process. */
  uint32_t only_one;
  /** Makes an object; called by one thread at a time. */
  swarmwright_status (*create)(void* context, void** physics);
  /** Ends an object; null if there is nothing to do. */
  void (*destroy)(void* physics);
  /** Goes to the start of an episode. SWARMWRIGHT_INVALID: the simulator cannot do that, and
   * swarmwright_set_parameter_error says which parameter of the mission it is about. */
  swarmwright_status (*start)(void* physics, const swarmwright_start* start);
  /** Moves on by a tick; a motion for each robot. */
  swarmwright_status (*step)(void* physics, const swarmwright_motion* robots, size_t count);
  /** Writes where all are. */
  swarmwright_status (*poses)(void* physics, swarmwright_pose* robots, swarmwright_pose* objects);
  /** Writes how far each proximity ray of a robot reaches from where it begins, metres, ray_range where it meets
   * nothing. Null for simulators without rays: they are computed from the poses, as at the start of each episode. */
  swarmwright_status (*rays)(void* physics, uint32_t robot, float* distances, size_t count);
} swarmwright_physics;

/** Connects to the broker and offers missions in a simulator; as swarmwright_server_open, with options.threads 1. */
swarmwright_status swarmwright_server_open_physics(const swarmwright_options* options,
                                                   const swarmwright_physics* physics,
                                                   swarmwright_server** server) SWARMWRIGHT_NOEXCEPT;

/* ---- A simulator that has its own loop. ---- */

/** A plug-in; used by one thread at a time. The server behind it has a thread of its own. */
typedef struct swarmwright_plugin swarmwright_plugin;

/** What a simulator is to do. */
#define SWARMWRIGHT_NOTHING 0
/** An episode is to begin with these parameters. Answer with sense, finish, refuse or fail. If another one was under
 * way, it was given up. */
#define SWARMWRIGHT_RESET 1
/** Those that sensed are to do this; make a step. Answer with sense, finish or fail. */
#define SWARMWRIGHT_STEP 2
/** The episode was given up, no tool waits for it any more. */
#define SWARMWRIGHT_ABANDONED 3

typedef struct swarmwright_event {
  size_t size;
  /** One of the above. */
  int32_t kind;
  /** Of a reset; they stay until the next poll. */
  const swarmwright_parameters* parameters;
  /** Of a reset: its parameter "seed", different in each of several episodes, 0 by default. */
  uint64_t seed;
  /** Of a step: a row for each agent that has sensed, in their order; they stay until the next poll. */
  const float* actuators;
  /** Numbers in `actuators`. */
  size_t count;
} swarmwright_event;

/** An event to be filled. */
#define SWARMWRIGHT_EVENT \
  { sizeof(swarmwright_event), SWARMWRIGHT_NOTHING, NULL, 0, NULL, 0 }

/** Connects to the broker and offers the simulator; as swarmwright_server_open. */
swarmwright_status swarmwright_plugin_open(const swarmwright_options* options,
                                           const swarmwright_description* description,
                                           swarmwright_plugin** plugin) SWARMWRIGHT_NOEXCEPT;
/** What to do next; waits for at most `seconds` until there is something, 0 to look only. While an answer is due it
 * never waits. An answer that takes more than 45 s costs the connection, unless the evaluation is offloaded. */
swarmwright_status swarmwright_plugin_poll(const swarmwright_plugin* plugin, double seconds,
                                           swarmwright_event* event) SWARMWRIGHT_NOEXCEPT;
/** Answers a reset or a step: these `count` agents act next, ascending from 0, and this is what they sense, a row for
 * each. None: the simulator steers its agents itself, and is told to make a step without actuators. */
swarmwright_status swarmwright_plugin_sense(const swarmwright_plugin* plugin, const uint32_t* agents, size_t count,
                                            const float* sensors) SWARMWRIGHT_NOEXCEPT;
/** Answers a reset or a step: the episode has ended. As many metrics as the description has. */
swarmwright_status swarmwright_plugin_finish(const swarmwright_plugin* plugin, double fitness,
                                             const double* metrics) SWARMWRIGHT_NOEXCEPT;
/** Answers a reset: a parameter cannot be used. */
swarmwright_status swarmwright_plugin_refuse(const swarmwright_plugin* plugin, const char* parameter,
                                             const char* reason) SWARMWRIGHT_NOEXCEPT;
/** Answers a reset or a step: the episode cannot go on. */
swarmwright_status swarmwright_plugin_fail(const swarmwright_plugin* plugin, const char* reason) SWARMWRIGHT_NOEXCEPT;
/** Gives up what is under way, leaves the broker and frees the plug-in. Null is nothing to do. */
swarmwright_status swarmwright_plugin_close(swarmwright_plugin* plugin) SWARMWRIGHT_NOEXCEPT;

#ifdef __cplusplus
}
#endif
#endif
