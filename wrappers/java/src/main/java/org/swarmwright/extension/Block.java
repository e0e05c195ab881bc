package org.swarmwright.extension;

import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.util.Arrays;

/** A growing array of numbers, little-endian. */
public final class Block {
  private ByteBuffer bytes = ByteBuffer.allocate(64).order(ByteOrder.LITTLE_ENDIAN);

  private ByteBuffer reserve(int more) {
    if (bytes.remaining() < more) {
      ByteBuffer larger =
          ByteBuffer.allocate(2 * bytes.capacity() + more).order(ByteOrder.LITTLE_ENDIAN);
      bytes = larger.put(bytes.flip());
    }
    return bytes;
  }

  /** Appends an integer of 32 bits. */
  public void add(int number) {
    reserve(Integer.BYTES).putInt(number);
  }

  /** Appends a binary32. */
  public void add(float number) {
    reserve(Float.BYTES).putFloat(number);
  }

  /** Appends a binary64. */
  public void add(double number) {
    reserve(Double.BYTES).putDouble(number);
  }

  /** Number of bytes. */
  public int size() {
    return bytes.position();
  }

  /** Keeps only the first bytes. */
  public void truncate(int size) {
    bytes.position(size);
  }

  byte[] bytes() {
    return Arrays.copyOf(bytes.array(), bytes.position());
  }
}
