package org.swarmwright.d61;

import java.io.DataInputStream;
import java.io.IOException;
import java.io.OutputStream;
import java.net.InetAddress;
import java.net.ServerSocket;
import java.net.Socket;
import java.nio.charset.StandardCharsets;

/**
 * As much of an MQTT 3.1.1 broker as lets one client connect and subscribe; it keeps what the
 * client publishes.
 */
final class Sink implements AutoCloseable {
  private final ServerSocket listener = new ServerSocket(0, 1, InetAddress.getLoopbackAddress());
  private final StringBuilder published = new StringBuilder();

  Sink() throws IOException {
    Thread thread = new Thread(this::serve, "sink");
    thread.setDaemon(true);
    thread.start();
  }

  int port() {
    return listener.getLocalPort();
  }

  private void serve() {
    try (Socket socket = listener.accept()) {
      DataInputStream in = new DataInputStream(socket.getInputStream());
      OutputStream out = socket.getOutputStream();
      for (int type = in.read(); type >= 0; type = in.read()) {
        byte[] packet = in.readNBytes(length(in));
        answer(type >> 4, packet, out);
      }
    } catch (IOException error) {
      note("closed");
    }
  }

  private static int length(DataInputStream in) throws IOException {
    int length = 0;
    for (int shift = 0; ; shift += 7) {
      int digit = in.readUnsignedByte();
      length |= (digit & 127) << shift;
      if (digit < 128) {
        return length;
      }
    }
  }

  private void answer(int type, byte[] packet, OutputStream out) throws IOException {
    if (type == 1) {
      out.write(new byte[] {0x20, 2, 0, 0});
    } else if (type == 8) {
      out.write(new byte[] {(byte) 0x90, 6, packet[0], packet[1], 0, 0, 0, 0});
    } else if (type == 3) {
      note(new String(packet, StandardCharsets.UTF_8));
    }
  }

  private synchronized void note(String text) {
    published.append(text);
    notifyAll();
  }

  /** All that was published, once a text is in it. */
  synchronized String await(String text) throws InterruptedException {
    long deadline = System.nanoTime() + 10_000_000_000L;
    while (published.indexOf(text) < 0) {
      long left = (deadline - System.nanoTime()) / 1_000_000;
      if (left <= 0) {
        throw new AssertionError(text + " did not come, only: " + published);
      }
      wait(left);
    }
    return published.toString();
  }

  @Override
  public void close() throws IOException {
    listener.close();
  }
}
