% Intensity and heat of all radial rows after a step, in the simulator's units: W/m^2, and W/m^2 per cm.
function [intensity, heat] = hitu_power(pressure, dissipated, layer, step, n_harmonics)
  squares = abs(pressure).^2;
  intensity = sum(squares, 2) / 2 / layer.rho / layer.c;
  absorbed = squares * (layer.fraction * real(layer.alpha(:)));
  shocked = sum(dissipated, 2) / step / (2 * n_harmonics - 1);
  heat = (absorbed + shocked) / layer.rho / layer.c;
end
