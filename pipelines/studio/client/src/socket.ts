// The socket of this page. What one side sends is kept until the other has it, over as many sockets as that takes.
import type { ToPage, ToServer } from "./messages";
import { packed, unpacked } from "./server";

export type Listener = (message: ToPage, payload: Uint8ClampedArray<ArrayBuffer>) => void;

const EMPTY = new Uint8Array();
const FIRST_WAIT = 500; // ms before the first attempt to connect again
const LONGEST_WAIT = 10_000;
const NUMBERS = 8; // bytes of the two numbers before a message: its own, and that of the last one that has arrived
const TELLING = 200; // ms until what has arrived is told, if no message tells it before
const TOO_MANY = 1013; // why the server has closed the socket
/** Requests of which only the newest of a group counts; they are made again where the server has forgotten this page. */
const GROUPS: Partial<Record<ToServer["kind"], string>> = {
  preview: "preview", preview_stop: "preview", alternatives: "preview", photo: "photo", lattice: "lattice",
};

interface Sent {
  number: number;
  frame: Uint8Array<ArrayBuffer>;
  group: string | undefined;
}

export class Socket {
  private readonly page = crypto.randomUUID();
  private socket: WebSocket | null = null;
  private wait = FIRST_WAIT;
  private isKnown = false;
  private number = 0;
  private received = 0;
  private kept: Sent[] = [];
  private readonly newest = new Map<string, [ToServer, Uint8Array]>();
  private telling = 0;

  constructor(
    private readonly listener: Listener,
    private readonly connected: (is: boolean) => void,
    private readonly renewed: () => void,
    private readonly refused: (problem: string) => void,
  ) {
    this.connect();
  }

  send(message: ToServer, payload: Uint8Array = EMPTY): void {
    const group = GROUPS[message.kind];
    if (group) this.newest.set(group, [message, payload]);
    if (!this.socket && group) this.kept = this.kept.filter((one) => one.group !== group);
    this.number += 1;
    const sent = { number: this.number, frame: packed(message, payload), group };
    this.kept.push(sent);
    this.transmit(sent);
  }

  /** Ask once more for what was asked for under a number, if nothing newer was. */
  repeat(number: number): void {
    const asked = [...this.newest.values()].find(([message]) => "number" in message && message.number === number);
    if (asked) this.send(...asked);
  }

  private transmit({ number, frame }: Sent): void {
    if (!this.isOpen()) return;
    clearTimeout(this.telling);
    this.telling = 0;
    this.socket!.send(numbered(number, this.received, frame));
  }

  /** Whether what is sent may arrive: a socket that is closing is still this page's, and complains. */
  private isOpen(): boolean {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  private connect(): void {
    const socket = new WebSocket(`ws://${location.host}/api/socket?page=${this.page}`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event: MessageEvent<ArrayBuffer>) => this.receive(socket, event.data);
    socket.onclose = (event) => {
      this.socket = null;
      this.connected(false);
      if (event.code === TOO_MANY) this.refused(event.reason);
      setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT);
    };
  }

  private receive(socket: WebSocket, data: ArrayBuffer): void {
    const numbers = new DataView(data);
    const [number, arrived] = [numbers.getUint32(0, true), numbers.getUint32(4, true)];
    this.kept = this.kept.filter((one) => one.number > arrived);
    if (data.byteLength === NUMBERS || (number && number <= this.received)) return;
    const [message, payload] = unpacked(data.slice(NUMBERS));
    if (message.kind === "connected") {
      this.begin(socket, message.is_new);
      return;
    }
    this.received = number;
    this.telling ||= window.setTimeout(() => {
      this.telling = 0;
      if (this.isOpen()) this.socket!.send(numbered(0, this.received));
    }, TELLING);
    this.listener(message, payload);
  }

  /** Go on over a new socket; where the server has forgotten the page, by asking for everything again. */
  private begin(socket: WebSocket, isNew: boolean): void {
    this.socket = socket;
    this.wait = FIRST_WAIT;
    const isForgotten = isNew && this.isKnown;
    this.isKnown = true;
    if (isNew) this.received = 0;
    if (isForgotten) {
      this.kept = [];
      [...this.newest.values()].forEach((one) => this.send(...one));
      this.renewed();
    } else {
      this.kept.forEach((one) => this.transmit(one));
    }
    this.connected(true);
  }
}

function numbered(number: number, received: number, frame: Uint8Array = EMPTY): Uint8Array<ArrayBuffer> {
  const sent = new Uint8Array(NUMBERS + frame.length);
  const numbers = new DataView(sent.buffer);
  numbers.setUint32(0, number, true);
  numbers.setUint32(4, received, true);
  sent.set(frame, NUMBERS);
  return sent;
}
