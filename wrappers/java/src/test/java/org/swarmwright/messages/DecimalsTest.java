package org.swarmwright.messages;

import static org.junit.jupiter.api.Assertions.assertEquals;

import java.util.Random;
import org.junit.jupiter.api.Test;

class DecimalsTest {
  @Test
  void knownCasesInWhichJavaBefore19IsLonger() {
    assertEquals(1, digits(Decimals.shortest(2e23)));
    assertEquals(1, digits(Decimals.shortest(2e-44f)));
    assertEquals(1, digits(Decimals.shortest(Double.MIN_VALUE)));
  }

  private static int digits(String decimal) {
    return decimal
        .replaceAll("[eE].*", "")
        .replaceAll("[^0-9]", "")
        .replaceAll("^0+", "")
        .replaceAll("0+$", "")
        .length();
  }

  @Test
  void everyNumberReadsBack() {
    Random random = new Random(1);
    for (int i = 0; i < 100_000; i++) {
      float single = Float.intBitsToFloat(random.nextInt());
      double number = Double.longBitsToDouble(random.nextLong());
      if (Float.isFinite(single) && Double.isFinite(number)) {
        assertEquals(single, Float.parseFloat(Decimals.shortest(single)));
        assertEquals(number, Double.parseDouble(Decimals.shortest(number)));
      }
    }
  }
}
