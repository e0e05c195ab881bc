package org.swarmwright.server;

/** A message is larger than the broker accepts, and was not sent. */
final class TooLarge extends RuntimeException {
  private static final long serialVersionUID = 1L;

  /** Names the message, the bytes of its packet and the limit. */
  TooLarge(String label, long bytes, long max) {
    super(
        label + " of " + bytes + " bytes is larger than the " + max + " that the broker accepts",
        null,
        false,
        false);
  }
}
