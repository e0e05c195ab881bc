package org.swarmwright.messages;

import java.math.BigDecimal;
import java.math.BigInteger;
import java.util.function.Predicate;

/**
 * The shortest decimals that read back as the same number; those of Java before version 19 are
 * sometimes longer.
 */
public final class Decimals {
  private static final boolean EXACT = Runtime.version().feature() >= 19;

  private Decimals() {}

  /** The decimal of a finite binary32, as JSON. */
  public static String shortest(float number) {
    String text = Float.toString(number);
    return EXACT || text.length() < 8 && Math.abs(number) >= Float.MIN_NORMAL
        ? trim(text)
        : shorten(text, shorter -> Float.parseFloat(shorter) == number);
  }

  /** The decimal of a finite binary64, as JSON. */
  public static String shortest(double number) {
    String text = Double.toString(number);
    return EXACT || text.length() < 17 && Math.abs(number) >= Double.MIN_NORMAL
        ? trim(text)
        : shorten(text, shorter -> Double.parseDouble(shorter) == number);
  }

  /** 2.0 becomes 2, -0.0 remains what it is. */
  private static String trim(String text) {
    boolean whole = text.endsWith(".0") && !text.equals("-0.0");
    return whole ? text.substring(0, text.length() - 2) : text;
  }

  /**
   * Removes digits while the decimal still reads back as the same number, by trying the two
   * decimals of that length next to it.
   */
  private static String shorten(String text, Predicate<String> same) {
    String best = text;
    BigDecimal exact = new BigDecimal(text).stripTrailingZeros();
    BigInteger digits = exact.unscaledValue();
    int scale = exact.scale();
    while (digits.abs().compareTo(BigInteger.TEN) >= 0) {
      BigInteger below = digits.divide(BigInteger.TEN);
      BigInteger above = below.add(BigInteger.valueOf(digits.signum()));
      boolean up = digits.abs().mod(BigInteger.TEN).intValue() >= 5;
      scale--;
      String nearest = new BigDecimal(up ? above : below, scale).toString();
      String far = new BigDecimal(up ? below : above, scale).toString();
      if (same.test(nearest)) {
        digits = up ? above : below;
        best = nearest;
      } else if (same.test(far)) {
        digits = up ? below : above;
        best = far;
      } else {
        break;
      }
    }
    return trim(best);
  }
}
