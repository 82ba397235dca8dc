// Steps back and forth through states.
const MOST = 200;

export class Undo<State> {
  private past: State[] = [];
  private future: State[] = [];

  constructor(public now: State) {}

  set(state: State): void {
    this.past = [...this.past, this.now].slice(-MOST);
    this.future = [];
    this.now = state;
  }

  get canUndo(): boolean {
    return this.past.length > 0;
  }

  get canRedo(): boolean {
    return this.future.length > 0;
  }

  undo(): void {
    if (!this.canUndo) return;
    this.future.push(this.now);
    this.now = this.past.pop()!;
  }

  redo(): void {
    if (!this.canRedo) return;
    this.past.push(this.now);
    this.now = this.future.pop()!;
  }
}
