package org.swarmwright.mqtt;

import static org.junit.jupiter.api.Assertions.assertArrayEquals;
import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertTrue;
import static org.junit.jupiter.api.Assumptions.assumeTrue;

import java.io.DataInputStream;
import java.io.IOException;
import java.io.InputStream;
import java.net.InetAddress;
import java.net.ServerSocket;
import java.net.Socket;
import java.util.Arrays;
import java.util.concurrent.CompletableFuture;
import java.util.concurrent.TimeUnit;
import jdk.net.ExtendedSocketOptions;
import org.junit.jupiter.api.Test;
import org.junit.jupiter.api.Timeout;

/** Against a peer that leaves Nagle's algorithm on. */
@Timeout(30)
class AcknowledgingSocketTest {
  private static final int ROUNDS = 31;

  private static Socket connect(ServerSocket listener) throws IOException {
    return new PromptSockets()
        .createSocket(InetAddress.getLoopbackAddress(), listener.getLocalPort());
  }

  @Test
  void smallPacketsNeedNotWaitForEachOther() throws Exception {
    try (ServerSocket listener = new ServerSocket(0, 1, InetAddress.getLoopbackAddress());
        Socket socket = connect(listener);
        Socket peer = listener.accept()) {
      assumeTrue(socket.supportedOptions().contains(ExtendedSocketOptions.TCP_QUICKACK));
      CompletableFuture<Void> answering =
          CompletableFuture.runAsync(
              () -> {
                try {
                  for (int round = 0; round < ROUNDS; round++) {
                    peer.getInputStream().read();
                    for (byte part = 0; part < 3; part++) {
                      peer.getOutputStream().write(part);
                    }
                  }
                } catch (IOException error) {
                  throw new IllegalStateException(error);
                }
              });
      long[] times = new long[ROUNDS];
      DataInputStream reader = new DataInputStream(socket.getInputStream());
      for (int round = 0; round < ROUNDS; round++) {
        long start = System.nanoTime();
        socket.getOutputStream().write(1);
        for (int part = 0; part < 3; part++) {
          assertEquals(part, reader.readByte());
        }
        times[round] = System.nanoTime() - start;
      }
      answering.get(5, TimeUnit.SECONDS);
      Arrays.sort(times);
      // The system by itself acknowledges after 40 ms.
      assertTrue(times[ROUNDS / 2] < 30_000_000, Arrays.toString(times));
    }
  }

  @Test
  void allBytesComeInOrderWhateverIsReadAtOnce() throws Exception {
    byte[] sent = new byte[100_000];
    for (int index = 0; index < sent.length; index++) {
      sent[index] = (byte) (index * 31 + index / 251);
    }
    try (ServerSocket listener = new ServerSocket(0, 1, InetAddress.getLoopbackAddress());
        Socket socket = connect(listener);
        Socket peer = listener.accept()) {
      peer.getOutputStream().write(sent);
      peer.shutdownOutput();
      InputStream stream = socket.getInputStream();
      byte[] received = new byte[sent.length];
      int[] sizes = {1, 3, 100, 8191, 8192, 20_000};
      int offset = 0;
      for (int turn = 0; offset < received.length; turn++) {
        int size = Math.min(sizes[turn % sizes.length], received.length - offset);
        if (size == 1) {
          received[offset++] = (byte) stream.read();
        } else {
          int count = stream.read(received, offset, size);
          assertTrue(count > 0);
          offset += count;
        }
      }
      assertArrayEquals(sent, received);
      assertEquals(-1, stream.read());
      assertEquals(-1, stream.read(received, 0, 5));
    }
  }
}
