package org.swarmwright.messages;

import com.google.gson.JsonArray;
import com.google.gson.JsonElement;
import com.google.gson.JsonNull;
import com.google.gson.JsonObject;
import com.google.gson.JsonPrimitive;
import com.google.gson.internal.LazilyParsedNumber;
import java.nio.ByteBuffer;
import java.nio.charset.CharacterCodingException;
import java.nio.charset.StandardCharsets;

/**
 * A strict JSON parser (RFC 8259) that keeps the decimals of numbers; of repeated keys the last one
 * counts.
 *
 * <p>Gson's parser accepts some invalid texts (half a surrogate pair), and refuses some long
 * integers.
 */
final class JsonText {
  /** The size limit of payloads; larger ones are refused without reading them. */
  static final int MAX_PAYLOAD = 1 << 20;

  private static final int MAX_NESTING = 127;

  private final String text;
  private int at;

  private JsonText(String text) {
    this.text = text;
  }

  /**
   * Reads one JSON object.
   *
   * @throws MessageException if the payload is too large, not in UTF-8, not valid JSON or not an
   *     object
   */
  static JsonObject read(byte[] payload) {
    if (payload.length > MAX_PAYLOAD) {
      throw new MessageException(
          payload.length + " bytes are more than the " + MAX_PAYLOAD + " of a message");
    }
    JsonText json;
    try {
      json =
          new JsonText(
              StandardCharsets.UTF_8.newDecoder().decode(ByteBuffer.wrap(payload)).toString());
    } catch (CharacterCodingException error) {
      throw new MessageException("not in UTF-8");
    }
    json.blank();
    JsonElement element = json.value(0);
    json.blank();
    if (json.at < json.text.length()) {
      throw json.wrong("nothing more");
    }
    if (!element.isJsonObject()) {
      throw new MessageException("not a JSON object");
    }
    return element.getAsJsonObject();
  }

  private MessageException wrong(String expected) {
    return new MessageException(
        "not valid JSON: expected " + expected + " at character " + (at + 1));
  }

  private char peek() {
    return at < text.length() ? text.charAt(at) : '\0';
  }

  private void blank() {
    while (peek() == ' ' || peek() == '\n' || peek() == '\r' || peek() == '\t') {
      at++;
    }
  }

  private boolean take(char c) {
    boolean matches = peek() == c && at < text.length();
    at += matches ? 1 : 0;
    return matches;
  }

  private JsonElement value(int depth) {
    char c = peek();
    if (c == '{') {
      return object(depth + 1);
    }
    if (c == '[') {
      return array(depth + 1);
    }
    if (c == '"') {
      return new JsonPrimitive(string());
    }
    if (c == '-' || c >= '0' && c <= '9') {
      return new JsonPrimitive(new LazilyParsedNumber(number()));
    }
    if (word("true")) {
      return new JsonPrimitive(true);
    }
    if (word("false")) {
      return new JsonPrimitive(false);
    }
    if (word("null")) {
      return JsonNull.INSTANCE;
    }
    throw wrong("a value");
  }

  private boolean word(String word) {
    boolean matches = text.startsWith(word, at);
    at += matches ? word.length() : 0;
    return matches;
  }

  private void nest(int depth) {
    if (depth > MAX_NESTING) {
      throw new MessageException("more than " + MAX_NESTING + " levels of JSON");
    }
    at++;
    blank();
  }

  private JsonObject object(int depth) {
    nest(depth);
    JsonObject object = new JsonObject();
    if (take('}')) {
      return object;
    }
    do {
      blank();
      if (peek() != '"') {
        throw wrong("a key");
      }
      String key = string();
      blank();
      if (!take(':')) {
        throw wrong(":");
      }
      blank();
      object.add(key, value(depth));
      blank();
    } while (take(','));
    if (!take('}')) {
      throw wrong("}");
    }
    return object;
  }

  private JsonArray array(int depth) {
    nest(depth);
    JsonArray array = new JsonArray();
    if (take(']')) {
      return array;
    }
    do {
      blank();
      array.add(value(depth));
      blank();
    } while (take(','));
    if (!take(']')) {
      throw wrong("]");
    }
    return array;
  }

  private String number() {
    int start = at;
    take('-');
    if (!take('0')) {
      digits();
    }
    if (take('.')) {
      digits();
    }
    if (take('e') || take('E')) {
      if (!take('+')) {
        take('-');
      }
      digits();
    }
    return text.substring(start, at);
  }

  private void digits() {
    int start = at;
    while (peek() >= '0' && peek() <= '9') {
      at++;
    }
    if (at == start) {
      throw wrong("a digit");
    }
  }

  private String string() {
    at++;
    int start = at;
    StringBuilder escaped = null;
    while (peek() != '"') {
      if (peek() < 0x20) {
        throw wrong("a character of a text");
      }
      if (peek() == '\\') {
        escaped = escaped == null ? new StringBuilder() : escaped;
        escaped.append(text, start, at);
        at++;
        escape(escaped);
        start = at;
      } else {
        at++;
      }
    }
    String rest = text.substring(start, at++);
    return escaped == null ? rest : escaped.append(rest).toString();
  }

  private void escape(StringBuilder out) {
    int index = "\"\\/bfnrt".indexOf(peek());
    if (at < text.length() && index >= 0) {
      out.append("\"\\/\b\f\n\r\t".charAt(index));
      at++;
    } else if (peek() == 'u') {
      char first = unit();
      out.append(first);
      if (Character.isHighSurrogate(first)) {
        if (!word("\\")) {
          throw wrong("the other half of a surrogate pair");
        }
        char second = unit();
        if (!Character.isLowSurrogate(second)) {
          throw wrong("the other half of a surrogate pair");
        }
        out.append(second);
      } else if (Character.isLowSurrogate(first)) {
        throw wrong("a whole surrogate pair");
      }
    } else {
      throw wrong("an escape");
    }
  }

  private char unit() {
    boolean fits =
        peek() == 'u'
            && at + 5 <= text.length()
            && text.substring(at + 1, at + 5).matches("[0-9a-fA-F]{4}");
    if (!fits) {
      throw wrong("u and four hexadecimal digits");
    }
    at += 5;
    return (char) Integer.parseInt(text.substring(at - 4, at), 16);
  }
}
