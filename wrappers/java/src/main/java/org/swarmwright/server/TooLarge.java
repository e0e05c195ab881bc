package org.swarmwright.server;

/** A message that the broker does not take: it was not sent, and would not be another time. */
final class TooLarge extends RuntimeException {
  private static final long serialVersionUID = 1L;

  /** Names what was to be sent, and how many bytes its packet has and may have. */
  TooLarge(String what, long bytes, long most) {
    super(
        what + " of " + bytes + " bytes is larger than the " + most + " that the broker takes",
        null,
        false,
        false);
  }
}
