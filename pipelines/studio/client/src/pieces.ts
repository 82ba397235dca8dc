// Pieces of an exemplar as `rectify_pieces` lays them. Places are continuous: pixel 0 reaches from 0 to 1.
import type { Piece } from "./messages";
import type { Drawable, Point } from "./picture-view";

export interface Box {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

export function boxOf(points: Point[]): Box {
  const [xs, ys] = [points.map(({ x }) => x), points.map(({ y }) => y)];
  return { left: Math.min(...xs), top: Math.min(...ys), right: Math.max(...xs), bottom: Math.max(...ys) };
}

function middle({ outline }: Piece): Point {
  const box = boxOf(outline);
  return { x: (box.left + box.right) / 2, y: (box.top + box.bottom) / 2 };
}

/** Where a place of the exemplar lies in the result. */
export function placed(piece: Piece, point: Point): Point {
  const [turn, center] = [(piece.angle * Math.PI) / 180, middle(piece)];
  const [x, y] = [(point.x - center.x) * piece.scale, (point.y - center.y) * piece.scale];
  return { x: piece.at.x + x * Math.cos(turn) + y * Math.sin(turn), y: piece.at.y - x * Math.sin(turn) + y * Math.cos(turn) };
}

/** Whether a place of the result lies in a piece. */
export function contains(piece: Piece, at: Point): boolean {
  const points = piece.outline.map((point) => placed(piece, point));
  let inside = false;
  points.forEach((one, index) => {
    const other = points[(index + 1) % points.length];
    if (one.y > at.y !== other.y > at.y && at.x < one.x + ((at.y - one.y) / (other.y - one.y)) * (other.x - one.x)) inside = !inside;
  });
  return inside;
}

/** The outline of a piece in the result, and the handles that turn and scale it. */
export function handles(piece: Piece, reach: number): { outline: Point[]; turn: Point; scale: Point } {
  const box = boxOf(piece.outline);
  const lifted = box.top - reach / piece.scale;
  return {
    outline: piece.outline.map((point) => placed(piece, point)),
    turn: placed(piece, { x: (box.left + box.right) / 2, y: lifted }),
    scale: placed(piece, { x: box.right, y: box.bottom }),
  };
}

/** Draw a piece into the result, whose pixel (0, 0) is at the origin of the context. */
export function drawPiece(context: CanvasRenderingContext2D, piece: Piece, exemplar: Drawable, size: [number, number]): void {
  const center = middle(piece);
  context.save();
  context.translate(piece.at.x, piece.at.y);
  context.rotate((-piece.angle * Math.PI) / 180);
  context.scale(piece.scale, piece.scale);
  context.translate(-center.x, -center.y);
  context.beginPath();
  piece.outline.forEach(({ x, y }) => context.lineTo(x, y));
  context.clip();
  context.drawImage(exemplar, 0, 0, size[1], size[0]);
  context.restore();
}

/** The content of the file of pieces; whole pixels of that are their middles. */
export function fileOf(pieces: Piece[]): object {
  const at = ({ x, y }: Point): [number, number] => [y - 0.5, x - 0.5];
  return {
    pieces: pieces.map((piece) => ({ polygon: piece.outline.map(at), at: at(piece.at), angle: piece.angle, scale: piece.scale })),
  };
}
