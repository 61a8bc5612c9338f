% SPDX-License-Identifier: GPL-3.0-or-later
% Written anew, but after the function of a GPL-3 program and of use inside that program alone; not distributed with arfjax.
%
% Nonlinear step of all radial rows at once, for the simulator's function of this name and with its interface.
%
% spectrum (row, harmonic) [Pa] becomes waveforms, these take upwind steps of the inviscid Burgers equation, each row as
% many as its own amplitude asks for, and go back. Rows whose fundamental is below a twentieth of the cutoff keep their
% spectrum and peaks. `dissipated` is the loss of summed squares; `waveform` the one nearest to the axis.
function [spectrum, waveform, highest, lowest, dissipated] = ...
    TDNL(spectrum, waveform, ~, n_harmonics, ~, courant, cutoff, highest, lowest, dissipated)
  if n_harmonics == 1
    highest = abs(spectrum(:, 1));
    lowest = -highest;
    return
  end
  dissipated(:) = 0;
  loud = find(abs(spectrum(:, 1)) >= cutoff / 20);
  if isempty(loud)
    return
  end
  wave = to_time(spectrum(loud, :), n_harmonics);
  before = sum(wave.^2, 1);
  n_steps = ceil(2 * courant * max(abs(wave), [], 1) / 0.9);
  for n = unique(n_steps)
    wave(:, n_steps == n) = steepen(wave(:, n_steps == n), courant, n);
  end
  dissipated(loud) = before - sum(wave.^2, 1);
  highest(loud) = max(wave, [], 1);
  lowest(loud) = min(wave, [], 1);
  waveform = wave(:, 1).';
  back = fft(wave, [], 1) / n_harmonics;
  spectrum(loud, :) = back(2:n_harmonics + 1, :)';
end

function wave = to_time(spectrum, n)
  mirrored = flipud(spectrum(:, 1:n - 1).');
  wave = n * real(ifft([zeros(1, rows(spectrum)); spectrum'; mirrored], [], 1));
end

function wave = steepen(wave, courant, n_steps)
  for step = 1:n_steps
    square = wave.^2;
    ahead = [square(2:end, :); square(1, :)] - square;
    behind = [ahead(end, :); ahead(1:end - 1, :)];
    falling = wave < 0;
    ahead(falling) = behind(falling);
    wave = wave + courant * ahead / n_steps;
  end
end
