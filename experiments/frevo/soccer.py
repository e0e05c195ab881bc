"""Simplified robot soccer, with the rules of FREVO's: `simulation: soccer.py:Soccer`."""

import math

from swarmwright import Group, Parameter, Side, Simulation
from swarmwright.display import Body, Scene

LENGTH, WIDTH = 54.0, 34.0  # half of the field, in metres; y points down
GOAL_LINE, GOAL = 55.0, 7.01  # x of the goals, half of their width
STEP = 100  # ms
DASH = 0.006  # m per step, for each unit of power up to 100
FASTEST, PLAYER_DECAY = 1.2, 0.4  # m per step, share of the speed that is left after a step
KICK, BALL_FASTEST, BALL_DECAY = 0.027, 2.7, 0.94  # the same of the ball
REACH, MARGIN = 0.7, 0.7  # m between player and ball to decide for a kick, and for its success
TOUCH = 0.3 + 0.085  # m, radii of player and ball
PATIENCE = 10  # steps in which nobody moves, after which a game ends

SENSORS = tuple(
    f"{target} {where}"
    for target in ("ball", "mate", "opponent", "border")
    for where in ("up", "down", "left", "right")
)


def is_inside(x, y):
    """Return whether a point is on the field or in a goal, however deep."""
    return abs(y) <= WIDTH and (abs(y) <= GOAL or abs(x) <= LENGTH)


def limit(x, y, most):
    length = math.hypot(x, y)
    return (x, y) if length <= most else (x * (most / length), y * (most / length))


def distances(points, point):
    return [math.hypot(point[0] - x, point[1] - y) for x, y in points]


class Player:
    """A player; its direction is in degrees, 0 is up and 90 to the right."""

    def __init__(self, x, y, direction):
        self.position, self.velocity, self.direction = (x, y), (0.0, 0.0), direction


class Soccer(Simulation):
    """Two teams and a ball. A side's fitness is 1, or -1 if the other side has the greater score.

    A score is the weighted sum of goals, of kicks, and of how well a team is placed and the ball for it,
    measured every few seconds. Sensors are mirrored for the right team, and its actuators, so that both can
    have the same controller: nearness of the ball, of the nearest team mate, of the nearest opponent and of
    the borders, each in four directions. A player kicks a slow ball nearby with the third and fourth
    actuator, and otherwise runs with the first and second.

    FREVO's controllers forget everything in each step; recurrent ones do not here.
    """

    title = "soccer"
    determinism = "bitwise"
    step_seconds = frame_seconds = STEP / 1000
    groups = {
        name: Group(
            "playersPerTeam",
            16,
            4,
            sensor_names=SENSORS,
            actuator_names=("run x", "run y", "kick x", "kick y"),
        )
        for name in ("left", "right")
    }
    sides = {"left": Side(fitness="left_result"), "right": Side(fitness="right_result")}
    parameters = {
        "playersPerTeam": Parameter(10, "Players of each team.", minimum=2, maximum=11),
        "position_weight": Parameter(1, "Weight of points of a grid near the team."),
        "ball_distance_weight": Parameter(1000, "Weight of a player that is nearest to the ball."),
        "kick_weight": Parameter(20_000, "Weight of a kick."),
        "ball_goal_weight": Parameter(100_000, "Weight of a ball near the other team's goal."),
        "score_weight": Parameter(4_000_000, "Weight of a goal."),
        "evaluation_time": Parameter(60_000, "Duration, ms.", minimum=STEP, maximum=10_000_000),
        "max_kicks": Parameter(10, "Kicks that count.", minimum=0),
    }
    metrics = {
        f"{side}_{name}": f"{text} of the {side} team."
        for side in ("left", "right")
        for name, text in (("result", "1, or -1 after defeat,"), ("score", "Score"), ("goals", "Goals"))
    }

    def reset(self, parameters, seed):
        self.weights = [
            parameters[key]
            for key in (
                "position_weight",
                "kick_weight",
                "score_weight",
                "ball_distance_weight",
                "ball_goal_weight",
            )
        ]
        self.most_kicks = parameters["max_kicks"]
        self.count, self.steps = parameters["playersPerTeam"], parameters["evaluation_time"] // STEP
        self.step_number, self.still, self.over = 0, 0, False
        self.spread, self.kicks, self.goals, self.nearest, self.ball_goal = ([0, 0] for _ in range(5))
        self.line_up()
        return self.observe()

    def line_up(self):
        rows = [10.0] * 3 + [20.0] * 5 + [30.0] + [40.0] * 2
        columns = [0.0, 10.0, -10.0, 0.0, 10.0, -10.0, 20.0, -20.0, 0.0, 10.0, -10.0]
        spots = list(zip(rows, columns))[: self.count]
        self.teams = [[Player(-x, y, 90.0) for x, y in spots], [Player(x, -y, 270.0) for x, y in spots]]
        self.ball, self.ball_velocity = (0.0, 0.0), (0.0, 0.0)

    def step(self, actions):
        moves = actions.astype(float).reshape(2, self.count, 4)
        moves[1] = -moves[1]
        slow = math.hypot(*self.ball_velocity) < 1.5
        kicks = [[slow and self.distance(player) < REACH for player in team] for team in self.teams]
        for number in range(self.count):
            for side, team in enumerate(self.teams):
                x, y, kick_x, kick_y = moves[side, number].tolist()
                if kicks[side][number]:
                    self.kick(side, team[number], kick_x, kick_y)
                else:
                    self.run(team[number], x, y)
        before = self.places() if self.step_number else None
        self.move()
        self.score(max(self.step_number - 1, 0))
        self.watch(before)
        self.step_number += 1
        return self.observe()

    def distance(self, player):
        return math.hypot(self.ball[0] - player.position[0], self.ball[1] - player.position[1])

    def places(self):
        return [player.position for team in self.teams for player in team]

    def run(self, player, x, y):
        player.direction = math.atan2(x, y) * 180.0 / math.pi
        push = DASH * min(int(100 * math.sqrt(x * x + y * y)), 100)
        angle = math.radians(player.direction)
        player.velocity = limit(
            player.velocity[0] + push * math.sin(angle), player.velocity[1] - push * math.cos(angle), FASTEST
        )

    def kick(self, side, player, x, y):
        power = min(int(100 * math.sqrt(x * x + y * y)), 100)
        gap = self.distance(player) - TOUCH
        if gap > MARGIN or not is_inside(*player.position) or power == 0:
            return
        away_x, away_y = self.ball[0] - player.position[0], self.ball[1] - player.position[1]
        away = math.hypot(away_x, away_y)
        toward = math.degrees(math.acos(max(-1.0, min(-away_y / away, 1.0)))) if away else 0.0
        turn = (360 - toward if away_x < 0 else toward) - player.direction
        strength = power * KICK * (1 - 0.25 * (turn / 180) - 0.25 * (gap / MARGIN))
        push = BALL_FASTEST / (strength or 1.0)  # weak kicks send it farther, as in FREVO
        angle = math.radians(math.atan2(x, y) * 180.0 / math.pi)
        self.ball_velocity = limit(
            self.ball_velocity[0] + push * math.sin(angle),
            self.ball_velocity[1] - push * math.cos(angle),
            BALL_FASTEST,
        )
        self.kicks[side] += 1

    def move(self):
        for player in (player for team in self.teams for player in team):
            position = (player.position[0] + player.velocity[0], player.position[1] + player.velocity[1])
            if is_inside(*position):
                player.position = position
            player.velocity = (player.velocity[0] * PLAYER_DECAY, player.velocity[1] * PLAYER_DECAY)
        position = (self.ball[0] + self.ball_velocity[0], self.ball[1] + self.ball_velocity[1])
        if is_inside(*position):
            self.ball = position
        self.ball_velocity = (self.ball_velocity[0] * BALL_DECAY, self.ball_velocity[1] * BALL_DECAY)
        if abs(self.ball[1]) <= GOAL and abs(self.ball[0]) >= GOAL_LINE:
            self.goals[0 if self.ball[0] > 0 else 1] += 1
            self.line_up()

    def score(self, number):
        """Add what is measured every five, four and two seconds, if `number` is such a step."""
        time = number * STEP
        teams = [[player.position for player in team] for team in self.teams]
        if time % 5000 == 0:
            for point in ((x, y) for y in range(30, -31, -10) for x in range(-40, 41, 10)):
                self.credit(self.spread, *(min(distances(team, point)) for team in teams))
        if time % 4000 == 0:
            self.credit(self.nearest, *(min(distances(team, self.ball)) for team in teams))
        if time % 2000 == 0:
            right, left = distances([(GOAL_LINE, 0.0), (-GOAL_LINE, 0.0)], self.ball)
            gap = min(right, left)
            points = 1 + (10 if gap < 7 else 3 if gap < 20 else 1 if gap < 30 else 0)
            self.credit(self.ball_goal, right, left, points)

    @staticmethod
    def credit(points, left, right, amount=1):
        if left != right:
            points[0 if left < right else 1] += amount

    def watch(self, before):
        """End the game if nobody moves any more."""
        if before is None:
            self.last = self.places()
            return
        if self.last == before:
            self.still += 1
        else:
            self.still, self.last = 0, before
        if self.still >= PATIENCE and self.step_number < self.steps:
            self.score(self.step_number)
            self.over = True

    def observe(self):
        return [self.look(side, player) for side, team in enumerate(self.teams) for player in team]

    def look(self, side, player):
        x, y = player.position
        mates = [other.position for other in self.teams[side] if other is not player]
        opponents = [other.position for other in self.teams[1 - side]]
        values = []
        for point in (self.ball, self.closest(mates, x, y), self.closest(opponents, x, y)):
            values += self.sense(point[0] - x, point[1] - y)
        values += [1 / (1 + gap) for gap in (WIDTH + y, WIDTH - y, LENGTH + x, LENGTH - x)]
        return values if side == 0 else [values[sensor ^ 1] for sensor in range(16)]

    @staticmethod
    def closest(points, x, y):
        away = distances(points, (x, y))
        return points[away.index(min(away))]

    @staticmethod
    def sense(x, y):
        away = max(math.hypot(x, y), REACH)
        squared = away * away
        up, left = abs(y / squared), abs(x / squared)
        return [*((up, 0.0) if y <= 0 else (0.0, up)), *((left, 0.0) if x <= 0 else (0.0, left))]

    def done(self):
        return self.over or self.step_number > self.steps

    def scores(self):
        spread, kick, goal, nearest, ball_goal = self.weights
        return [
            self.spread[side] * spread
            + min(self.kicks[side], self.most_kicks) * kick
            + self.goals[side] * goal
            + self.nearest[side] * nearest
            + self.ball_goal[side] * ball_goal
            for side in (0, 1)
        ]

    def fitness(self):
        left, right = self.scores()
        return float(left - right)

    def measure(self):
        scores = self.scores()
        best = max(scores)
        return {
            f"{name}_{key}": float(value)
            for name, score, goals in zip(("left", "right"), scores, self.goals)
            for key, value in (("result", 1 if score == best else -1), ("score", score), ("goals", goals))
        }

    def scene(self):
        bodies = [
            Body(kind, player.position[0] + 60, 40 - player.position[1], "free", 0.9)
            for kind, team in zip(("agent", "defender"), self.teams)
            for player in team
        ]
        bodies.append(Body("goal", self.ball[0] + 60, 40 - self.ball[1], "free", 0.6))
        return Scene(120, 80, self.step_number, f"{self.goals[0]} : {self.goals[1]}", bodies)
