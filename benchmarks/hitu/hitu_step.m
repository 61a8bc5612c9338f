% Called after each step: notes its time, and after `stop_after` steps saves the state and leaves by an error.
%
% hitu_step("begin", stop_after, file) starts the clock; hitu_step("seconds") returns the time of each step since.
function out = hitu_step(what, varargin)
  persistent stop_after file clock seconds
  out = [];
  switch what
    case "begin"
      [stop_after, file] = varargin{:};
      seconds = [];
      clock = tic;
    case "seconds"
      out = seconds;
    case "done"
      seconds(end + 1) = toc(clock);
      if numel(seconds) == stop_after
        [pressure, heat, highest, lowest] = varargin{:};
        save("-v7", file, "pressure", "heat", "highest", "lowest");
        error("hitu:stop", "%d steps done", stop_after);
      end
  end
end
