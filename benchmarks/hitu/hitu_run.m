% Run the prepared simulator on the five-layer case and write what came out as JSON (and the state, when stopped).
%
% `asked` as in hitu_case, with `stop_after` steps (0: the whole march) and the file `state` for what it had then.
function hitu_run(asked, out)
  begun = tic;
  hitu_step("begin", asked.stop_after, asked.state);
  result = struct("octave", version(), "tdnl", which("TDNL"));
  try
    [grid, layers, heat, highest, lowest] = hitu_march(asked);
    result = profiles(result, grid, layers, heat, highest, lowest);
  catch stopped
    if ! strcmp(stopped.identifier, "hitu:stop")
      rethrow(stopped);
    end
  end
  result.seconds = toc(begun);
  result.step_end_s = hitu_step("seconds");
  id = fopen(out, "w");
  fputs(id, jsonencode(result));
  fclose(id);
end

function result = profiles(result, grid, layers, heat, highest, lowest)
  % To SI; the heat of a step is W/m^2 per cm.
  result.z_m = grid.z(:)' * 1e-2;
  result.n_radial = numel(grid.r);
  result.p_pos_axis_pa = highest(1, :);
  result.p_neg_axis_pa = lowest(1, :);
  result.heat_axis_w_m3 = heat(1, :) * 100;
end
