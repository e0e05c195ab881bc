package org.swarmwright.controllers;

/**
 * tanh, sigmoid, sine and cosine as fixed sequences of binary32 operations, the same bits in every
 * language.
 *
 * <p>docs/decisions/002-arithmetic.md writes them down, with their error (at most 2e-7) and why.
 * Every line is one operation, or one comparison that selects and lets a NaN pass.
 */
public final strictfp class Functions {
  private static final float LIMIT = 9.15f;
  private static final float P0 = 0.5f;
  private static final float P1 = 0.015736774f;
  private static final float P2 = 7.970824e-5f;
  private static final float P3 = 4.2581547e-8f;
  private static final float Q0 = 1f;
  private static final float Q1 = 0.11480684f;
  private static final float Q2 = 0.0013933508f;
  private static final float Q3 = 2.7218455e-6f;
  private static final float S0 = 3.1415927f;
  private static final float S1 = -5.167707f;
  private static final float S2 = 2.5500288f;
  private static final float S3 = -0.59804523f;
  private static final float S4 = 0.077220164f;

  private Functions() {}

  /** Hyperbolic tangent, in -1..1. */
  public static float tanh(float x) {
    float y = x > LIMIT ? LIMIT : x;
    y = y < -LIMIT ? -LIMIT : y;
    float z = y * y;
    float p = ((P3 * z + P2) * z + P1) * z + P0;
    float q = ((Q3 * z + Q2) * z + Q1) * z + Q0;
    float t = (y * p) / q;
    float h = (t + t) / (1f + t * t);
    h = h > 1f ? 1f : h;
    return h < -1f ? -1f : h;
  }

  /** Logistic function, in 0..1. */
  public static float sigmoid(float x) {
    return 0.5f + 0.5f * tanh(0.5f * x);
  }

  /** sin(pi * a) for a in -1..1. */
  public static float sinPi(float a) {
    float r = a > 0.5f ? 1f - a : a;
    r = a < -0.5f ? -1f - a : r;
    return sinPiHalf(r);
  }

  /** cos(pi * a) for a in -1..1. */
  public static float cosPi(float a) {
    float b = a < 0f ? -a : a;
    return sinPiHalf(0.5f - b);
  }

  private static float sinPiHalf(float r) {
    float z = r * r;
    float p = (((S4 * z + S3) * z + S2) * z + S1) * z + S0;
    float s = r * p;
    s = s > 1f ? 1f : s;
    return s < -1f ? -1f : s;
  }
}
