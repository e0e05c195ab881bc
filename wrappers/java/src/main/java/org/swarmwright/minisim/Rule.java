package org.swarmwright.minisim;

import org.swarmwright.ParameterReader;

/** A steering rule: towards the goal, and around the closest defender. */
final strictfp class Rule {
  private final float avoidance;
  private final float radius;
  private final String evasion;

  Rule(ParameterReader read) {
    avoidance = read.notNegative("avoidance", 1f);
    radius = read.notNegative("avoidanceRadius", 2f);
    evasion = read.choice("evasion", "away", "left", "right");
  }

  /**
   * The direction of an agent, of any length; {@code defender} is the closest one, null if there is
   * none.
   */
  float[] way(float[] from, float[] goal, float[] defender) {
    float d = Minisim.distance(from, goal);
    float[] way = new float[2];
    if (d > 0f) {
      way[0] = (goal[0] - from[0]) / d;
      way[1] = (goal[1] - from[1]) / d;
    }
    float r = defender == null ? 0f : Minisim.distance(from, defender);
    if (r > 0f && r < radius) {
      float ex = defender[0] - from[0];
      float ey = defender[1] - from[1];
      float vx = evasion.equals("away") ? -ex : evasion.equals("left") ? -ey : ey;
      float vy = evasion.equals("away") ? -ey : evasion.equals("left") ? ex : -ex;
      float s = avoidance * (1f - r / radius);
      way[0] = way[0] + s * (vx / r);
      way[1] = way[1] + s * (vy / r);
    }
    return way;
  }
}
