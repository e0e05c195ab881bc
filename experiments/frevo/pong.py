"""Pong, with the rules of FREVO's: `simulation: pong.py:Pong`."""

import numpy as np

from swarmwright import Group, Parameter, Side, Simulation
from swarmwright.display import Body, Scene

WIDTH, HEIGHT, WALL = 640, 480, 12  # of the field and of its walls above and below, in pixels; y points down
PADDLE, BALL = 12, 5  # width of a paddle, radius of a ball
STEP = 40.0 / 1000  # s
ACCELERATION = 8.0  # of a ball, pixels/s^2
SPEED = (WIDTH - 2 * BALL) / 4.0  # of a ball at first, in x and in y, pixels/s
LOW, HIGH = WALL + BALL, HEIGHT - WALL - BALL  # of a ball
REMEMBERED = 3  # positions after which the oldest says where a ball is going

SENSORS = ("position", "teammate", "ball")


class JavaRandom:
    """java.util.Random, as its documentation defines it."""

    def __init__(self, seed):
        self.state = (seed ^ 0x5DEECE66D) % 2**48

    def integer(self, bound):
        """Return a number from 0 to bound - 1."""
        while True:
            self.state = (self.state * 0x5DEECE66D + 11) % 2**48
            bits = self.state >> 17
            if bound & -bound == bound:
                return bound * bits >> 31
            if bits - bits % bound + bound - 1 < 2**31:
                return bits % bound


class Paddle:
    """A paddle: its upper end, and whether it moved up (-), down (+) or not at all in the last step."""

    def __init__(self, side, top, height):
        self.side, self.top, self.height = side, top, height
        self.left = side * (WIDTH - PADDLE)
        self.moving = 0.0

    @property
    def middle(self):
        return (2 * self.top + self.height) // 2

    def move(self, velocity, speed):
        self.moving = velocity
        if velocity != 0:
            top = self.top + velocity * STEP * speed
            self.top = int(min(max(top, WALL), HEIGHT - WALL - self.height))

    def hit(self, x, y, dx, dy):
        """Return where a ball that moves by (dx, dy) hits: the axis it bounces along, and the coordinate."""
        left, right = self.left - BALL, self.left + PADDLE + BALL
        top, bottom = self.top - BALL, self.top + self.height + BALL
        if dx:
            edge = right if dx < 0 else left
            point = cross(x, y, x + dx, y + dy, edge, top, edge, bottom)
            if point:
                return 0, int(point[0])
        if dy:
            edge = bottom if dy < 0 else top
            point = cross(x, y, x + dx, y + dy, left, edge, right, edge)
            if point:
                return 1, int(point[1])
        return None


class Ball:
    """A ball, which is served anew after each goal."""

    def __init__(self, number):
        self.number = number

    def serve(self, side, y):
        """Place the ball; `side` is 0 if ball 0 starts at the left."""
        half = (WIDTH - 2 * BALL) // 2
        starts = (
            (BALL, WIDTH - BALL),
            (WIDTH - BALL, BALL),
            (BALL + half, BALL + half),
            (BALL + half, BALL + half),
            (WIDTH - BALL - half // 2, BALL + half // 2),
            (BALL + half // 2, WIDTH - BALL - half // 2),
        )
        to_right = (side == 0) == (self.number in {0, 2, 5})
        self.x, self.y = starts[self.number][side], y
        self.dx, self.dy = SPEED if to_right else -SPEED, SPEED
        self.past = []

    def approaches(self, side):
        if not self.past:
            return True
        return self.x <= self.past[0] if side == 0 else self.x >= self.past[0]

    def move(self, teams):
        gain = ACCELERATION * STEP
        rise = ACCELERATION * STEP * STEP * 0.5
        new_x = self.x + STEP * self.dx + rise
        new_y = self.y + STEP * self.dy + rise
        way = new_x - self.x, new_y - self.y
        x, y = int(new_x), int(new_y)
        dx = self.dx + (gain if self.dx > 0 else -gain)
        dy = self.dy + (gain if self.dy > 0 else -gain)
        if (dy > 0 and y > HIGH) or (dy < 0 and y < LOW):
            y, dy = (HIGH if dy > 0 else LOW), -dy
        for pair in zip(*teams):
            paddle = pair[0 if dx < 0 else 1]
            bounce = paddle.hit(self.x, self.y, *way)
            if bounce:
                axis, edge = bounce
                if axis == 0:
                    x, dx = edge, -dx
                else:
                    y, dy = edge, -dy
                if paddle.moving:  # a ball that the paddle goes along with becomes slower
                    dy *= 0.5 if (paddle.moving < 0) == (dy < 0) else 1.5
                break
        self.past = [*self.past, self.x][-REMEMBERED:]
        self.x, self.y, self.dx, self.dy = x, y, dx, dy


def cross(x1, y1, x2, y2, x3, y3, x4, y4):
    """Return where two line segments cross, or None."""
    area = (y4 - y3) * (x2 - x1) - (x4 - x3) * (y2 - y1)
    if area == 0:
        return None
    along = ((x4 - x3) * (y1 - y3) - (y4 - y3) * (x1 - x3)) / area
    across = ((x2 - x1) * (y1 - y3) - (y2 - y1) * (x1 - x3)) / area
    if not (0 <= along <= 1 and 0 <= across <= 1):
        return None
    return x1 + along * (x2 - x1), y1 + along * (y2 - y1)


class Pong(Simulation):
    """Two teams of paddles; a side's fitness is its goals in three games.

    Sensors are mirrored for the right team, so that both can have the same controller: the paddle's position
    (0 to 1), the nearest team mate, and the nearest approaching ball (shares of the height of the field). An
    actuator above 0 moves a paddle of the left team up, and one of the right team down.

    FREVO's controllers forget everything in each step; recurrent ones do not here.
    """

    title = "pong"
    determinism = "bitwise"
    step_seconds = frame_seconds = STEP
    groups = {
        name: Group("playersPerTeam", 3, 1, sensor_names=SENSORS, actuator_names=("speed",))
        for name in ("left", "right")
    }
    sides = {"left": Side(fitness="left_goals"), "right": Side(fitness="right_goals")}
    parameters = {
        "playersPerTeam": Parameter(3, "Paddles of each team.", minimum=1, maximum=100),
        "paddleHeight": Parameter(60, "Height of a paddle, pixels.", minimum=1, maximum=400),
        "paddleSpeed": Parameter(4.0, "Time that a paddle takes across the field, s.", minimum=0.01),
        "numberOfBalls": Parameter(1, "Balls.", minimum=1, maximum=6),
        "maximumSteps": Parameter(2000, "Steps of a game, of 0.04 s.", minimum=1, maximum=100_000),
    }
    metrics = {"left_goals": "Goals of the left team.", "right_goals": "Goals of the right team."}
    games = 3

    def reset(self, parameters, seed):
        self.random = JavaRandom(seed)
        self.players, self.height = parameters["playersPerTeam"], parameters["paddleHeight"]
        self.speed = (HEIGHT - 2 * WALL - self.height) / parameters["paddleSpeed"]
        self.game_steps = parameters["maximumSteps"]
        self.balls = [Ball(number) for number in range(parameters["numberOfBalls"])]
        self.steps, self.serving, self.goals = 0, 0, [0, 0]
        self.begin()
        return self.observe()

    def begin(self):
        gap = HEIGHT // (self.players + 1)
        tops = [HEIGHT - gap * (index + 1) - self.height // 2 for index in range(self.players)]
        self.teams = [
            [Paddle(0, top, self.height) for top in reversed(tops)],
            [Paddle(1, top, self.height) for top in tops],
        ]
        for ball in self.balls:
            ball.serve(self.serving, self.draw())
            self.serving = 1 - self.serving

    def draw(self):
        return LOW + self.random.integer(HIGH - LOW)

    def step(self, actions):
        speeds = actions[:, 0].tolist()
        for paddle, speed in zip(self.teams[0] + self.teams[1], speeds):
            paddle.move(speed if paddle.side else -speed, self.speed)
        for ball in self.balls:
            ball.move(self.teams)
            if ball.x - BALL > WIDTH or ball.x + BALL < 0:
                self.goals[0 if ball.x > 0 else 1] += 1
                for other in self.balls:
                    other.serve(self.serving, self.draw())
                self.serving = 1 - self.serving
        self.steps += 1
        if self.steps % self.game_steps == 0 and not self.done():
            self.begin()
        return self.observe()

    def observe(self):
        return [self.look(paddle) for team in self.teams for paddle in team]

    def look(self, paddle):
        team, mirror = self.teams[paddle.side], -1 if paddle.side else 1
        position = float(np.float32(paddle.middle / HEIGHT))
        mates = [mate.top - paddle.top for mate in team if mate is not paddle]
        mate = mirror * min(mates, key=abs) / HEIGHT if mates else 1.0
        ball = mirror * (self.watch(paddle).y - paddle.middle) / HEIGHT
        return [1 - position if paddle.side else position, mate, ball]

    def watch(self, paddle):
        """Return the nearest ball that approaches; if none does, the farthest."""

        def distance(ball):
            return (paddle.left + PADDLE // 2 - ball.x) ** 2 + (paddle.middle - ball.y) ** 2

        approaching = [ball for ball in self.balls if ball.approaches(paddle.side)]
        return min(approaching, key=distance) if approaching else max(self.balls, key=distance)

    def done(self):
        return self.steps == self.games * self.game_steps

    def fitness(self):
        return float(self.goals[0] - self.goals[1])

    def measure(self):
        return {"left_goals": float(self.goals[0]), "right_goals": float(self.goals[1])}

    def scene(self):
        bodies = [
            Body(kind, (paddle.left + PADDLE / 2) / 100, (HEIGHT - paddle.middle) / 100, "free", 0.1)
            for kind, team in zip(("agent", "defender"), self.teams)
            for paddle in team
        ]
        bodies += [
            Body("goal", ball.x / 100, (HEIGHT - ball.y) / 100, "free", BALL / 100) for ball in self.balls
        ]
        score = f"{self.goals[0]} : {self.goals[1]}"
        return Scene(WIDTH / 100, HEIGHT / 100, self.steps, score, bodies)
