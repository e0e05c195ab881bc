package org.swarmwright.minisim;

import java.util.Arrays;

/**
 * The map as text: a character for each square metre, A agents, D defenders, X the goal; the origin
 * is at the bottom left.
 */
final class Picture {
  private static final int WIDEST = 120;

  private Picture() {}

  static String draw(Settings settings, long step, float[][] agents, float[][] defenders) {
    float scale = Math.max(1f, Math.max(settings.width, settings.height) / WIDEST);
    char[][] rows =
        new char[(int) Math.ceil(settings.height / scale)][(int) Math.ceil(settings.width / scale)];
    for (char[] row : rows) {
      Arrays.fill(row, '.');
    }
    put(rows, settings.goal, scale, 'X');
    for (float[] defender : defenders) {
      put(rows, defender, scale, 'D');
    }
    for (float[] agent : agents) {
      put(rows, agent, scale, 'A');
    }
    StringBuilder text = new StringBuilder(settings.helloMessage).append(", step ").append(step);
    for (char[] row : rows) {
      text.append('\n').append(row);
    }
    return text.toString();
  }

  private static void put(char[][] rows, float[] at, float scale, char sign) {
    int row = rows.length - 1 - Math.min(rows.length - 1, (int) (at[1] / scale));
    int column = Math.min(rows[0].length - 1, (int) (at[0] / scale));
    rows[row][column] = sign;
  }
}
