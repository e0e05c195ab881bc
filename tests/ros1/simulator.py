"""Robots on a plane that drive to a goal: a simulator as people have it, which knows nothing of Swarmwright.

    python3 simulator.py [--robots 2] [--realtime] [--steers-itself] [--fault FAULT]

A step is a call of /step, or passes by itself with --realtime. Robots that steer themselves drive ahead with
the speed of the parameter /simulator/speed. Faults: `dies`, `silent`, `nan`, `wrong_type`, `step_fails`,
`reset_fails`, `deaf`.
"""

# mypy: ignore-errors

import argparse
import math
import os
import random
import sys
import threading

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from std_srvs.srv import Empty, EmptyResponse, Trigger, TriggerResponse

GOAL = 3.0
STEP = 0.1
changed = threading.Condition()


class Robot:
    def __init__(self, name, fault):
        self.name = name
        self.goal = rospy.Publisher(f"{name}/goal", Twist, queue_size=10)
        kind = Twist if fault == "wrong_type" else Odometry
        self.odometry = rospy.Publisher(f"{name}/odom", kind, queue_size=10)
        self.command = None
        if fault != "deaf":
            rospy.Subscriber(f"{name}/cmd_vel", Twist, self.take)
        self.reset(0.0, 0.0)

    def take(self, command):
        with changed:
            self.command = command
            changed.notify_all()

    def reset(self, x, y):
        self.x, self.y, self.yaw, self.command = x, y, 0.0, None

    def move(self):
        if self.command is not None:
            self.yaw += STEP * self.command.angular.z
            self.x += STEP * self.command.linear.x * math.cos(self.yaw)
            self.y += STEP * self.command.linear.x * math.sin(self.yaw)

    def publish(self, fault):
        if self.name == "robot_1" and fault == "silent":
            return
        if given.fault == "wrong_type":
            self.odometry.publish(Twist())
        else:
            odometry = Odometry()
            odometry.pose.pose.position.x, odometry.pose.pose.position.y = self.x, self.y
            self.odometry.publish(odometry)
        goal = Twist()
        dx, dy = GOAL - self.x, -self.y
        goal.linear.x = math.cos(self.yaw) * dx + math.sin(self.yaw) * dy
        goal.linear.y = math.cos(self.yaw) * dy - math.sin(self.yaw) * dx
        if self.name == "robot_1" and fault == "nan":
            goal.linear.y = math.nan
        self.goal.publish(goal)


class Simulator:
    def __init__(self):
        self.steps = 0
        self.robots = [Robot(f"robot_{number + 1}", given.fault) for number in range(given.robots)]
        rospy.Service("/reset", Trigger if given.fault == "reset_fails" else Empty, self.reset)
        rospy.Service("/step", Trigger, self.step)

    @property
    def fault(self):
        return given.fault if self.steps >= 5 else ""

    def reset(self, _):
        if given.fault == "reset_fails":
            return TriggerResponse(False, "the world is locked")
        numbers = random.Random(rospy.get_param("/simulator/seed", 0))
        with changed:
            self.steps = 0
            for robot in self.robots:
                robot.reset(numbers.uniform(-1, 1), numbers.uniform(-1, 1))
                robot.publish(self.fault)
        return EmptyResponse()

    def step(self, _):
        # Topics and services have no common order: a step begins when every robot has its command.
        if given.steers_itself:
            command = Twist()
            command.linear.x = rospy.get_param("/simulator/speed")
            for robot in self.robots:
                robot.take(command)
        with changed:
            changed.wait_for(lambda: all(robot.command is not None for robot in self.robots), 2)
            self.steps += 1
            if self.fault == "dies":
                sys.stderr.write("the engine is on fire\n")
                sys.stderr.flush()
                os._exit(7)
            if self.fault == "step_fails":
                return TriggerResponse(False, "physics diverged")
            for robot in self.robots:
                robot.move()
                robot.publish(self.fault)
                robot.command = None
        return TriggerResponse(True, "")

    def run(self):
        rate = rospy.Rate(1 / STEP)
        while not rospy.is_shutdown():
            rate.sleep()
            with changed:
                self.steps += 1
                for robot in self.robots:
                    robot.move()
                    robot.publish(self.fault)


parser = argparse.ArgumentParser()
parser.add_argument("--robots", type=int, default=2)
parser.add_argument("--realtime", action="store_true")
parser.add_argument("--steers-itself", action="store_true")
parser.add_argument("--fault", default="")
given = parser.parse_args(rospy.myargv()[1:])
rospy.init_node("simulator")
simulator = Simulator()
simulator.run() if given.realtime else rospy.spin()
