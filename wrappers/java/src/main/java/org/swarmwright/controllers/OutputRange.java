package org.swarmwright.controllers;

/** The interval of network outputs that is mapped to actuators from -1 to 1. */
final strictfp class OutputRange {
  /** Outputs from 0 to 1. */
  static final OutputRange UNIT = new OutputRange(0f, 1f);

  private final float low;
  private final float high;

  private OutputRange(float low, float high) {
    this.low = low;
    this.high = high;
  }

  /** Null unless low is less than high and their distance is a finite binary32 above 0. */
  static OutputRange of(float low, float high) {
    float width = high - low;
    boolean fits =
        Float.isFinite(low) && Float.isFinite(high) && Float.isFinite(width) && width > 0f;
    return fits ? new OutputRange(low, high) : null;
  }

  float actuator(float output) {
    float a;
    if (low == -1f && high == 1f) {
      a = output;
    } else if (low == 0f && high == 1f) {
      a = 2f * output - 1f;
    } else {
      a = ((output - low) / (high - low)) * 2f - 1f;
    }
    a = Float.isNaN(a) ? 0f : a;
    a = a > 1f ? 1f : a;
    return a < -1f ? -1f : a;
  }
}
